"""Counts of radiation or of a plume: their intensity as a map with intervals, and the place of their source."""
