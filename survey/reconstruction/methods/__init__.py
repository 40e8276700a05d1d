"""Reconstruction methods by kind: name, needs, settings, and the functions that run them.

The models of `gp`, `joint`, `lattice` and `carving` are imported when a method runs, because compiled support takes
half a second that other commands need not pay.
"""
