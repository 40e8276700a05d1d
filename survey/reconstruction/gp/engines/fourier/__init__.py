"""Gaussian process in the weights of Fourier waves: its basis, resolution, mean, posterior and evidence.

Begin with `gaussian_process`, the engine.
"""
