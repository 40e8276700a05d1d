"""Gaussian processes: kernels, their hyperparameters, the engines, and the terrain model about a mean.

Begin with `reference`, the method in the paper's equations; then `fit` and `gp_terrain`. `engines.regression` holds
the exact engine, `engines.fourier_gp` the fast one.
"""
