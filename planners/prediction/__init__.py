"""Prediction of the error of a map from the places of its samples and a coarse prior, before anything is driven."""
