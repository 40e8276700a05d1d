"""Figures of checks of a map: its calibration, and points that were left out. Other figures of a map lie beside."""
