"""Compiled multigrid and conjugate-gradient solver for lattices.

It solves linear and one-sided systems of a stencil; what the stencil means is decided one folder up.
"""
