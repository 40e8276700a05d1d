"""Gaussian-process regression: dense Cholesky, Fourier weights, and Fourier weights in tiles.

Engines work on plain arrays about a zero or polynomial mean; terrain and its prior live one folder up.
"""
