"""Simulated and real terrain: random fields, landforms, ice micro-relief, and the satellite prior of it."""

from survey.terrain.random_fields import (
    fractional_brownian,
    matern_field,
    spectral_field,
    squared_exponential_field,
)
from survey.terrain.real import SampleSite, real_sample, sample_site
from survey.terrain.satellite import SatelliteDem, satellite_copy, smooth_interpolation
from survey.terrain.synthetic import (
    cosine_surface,
    diamond_square,
    gaussian_hills,
    ice_micro_relief,
    random_dem,
    slope_and_waves,
)

__all__ = [
    "SampleSite",
    "SatelliteDem",
    "cosine_surface",
    "diamond_square",
    "fractional_brownian",
    "gaussian_hills",
    "ice_micro_relief",
    "matern_field",
    "random_dem",
    "real_sample",
    "sample_site",
    "satellite_copy",
    "slope_and_waves",
    "smooth_interpolation",
    "spectral_field",
    "squared_exponential_field",
]
