"""Terrain on the nodes of a lattice, updated scan by scan.

Begin with `field_lattice`, a Gaussian field, and `spring_lattice`, the EMap; `free_lattice` moves its nodes in x, y and z. `field_posterior` is the mathematics of
the field, `calibration` scales its standard deviation, and `stencil`, `multigrid` and `solver` are the arithmetic of both.
"""
