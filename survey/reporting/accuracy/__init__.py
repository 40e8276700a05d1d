"""Accuracy reports: a map at checkpoints, a map against a reference raster, and a change between two surveys."""
