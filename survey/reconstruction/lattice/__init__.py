"""Terrain on the nodes of a lattice, updated scan by scan.

Begin with `field_lattice`, a Gaussian field, and `spring_lattice`, the EMap; `stencil`,
`point_sums`, `coarsening`, `multigrid` and `solver` are their arithmetic.
"""
