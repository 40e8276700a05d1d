"""Errors that the points of a strip share: differences in overlaps, control points, least squares."""
