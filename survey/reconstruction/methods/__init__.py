"""Reconstruction methods, one module each: name, needs, settings, and the functions that run them.

The models themselves live in `gp`, `joint`, `lattice`, `carving` and `triangulation`; they are
imported when a method runs, because compiled support takes half a second that other commands need not pay.
"""
