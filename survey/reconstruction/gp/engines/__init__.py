"""Engines of Gaussian-process regression: exact by Cholesky, in Fourier weights, and in tiles.

`regression` holds the exact engine, `fourier_gp` the one in Fourier weights, `tiled_gp` and `local_gp` those that divide the site.
Engines work on plain arrays about a zero or polynomial mean; terrain and its prior live one folder up.
"""
