"""Gaussian processes: kernels and how they are learned, the engines, and the terrain model about a mean.

Begin with `gp_terrain`; `gaussian_process` is the engine in the weights of Fourier waves,
`dense_gp` the exact one that it is held against.
"""
