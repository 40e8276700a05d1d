"""Hazards of a rover read from a map and its covariance; begin with `slope_hazard`."""
