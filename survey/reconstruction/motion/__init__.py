"""Surveys on moving ice: reduction of recordings to an epoch, velocity from stakes, and the age of a map."""
