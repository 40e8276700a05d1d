"""Error model of a prior elevation model: product classes, settings, likeliest errors, conflicts with points.

The module imports nothing of the reconstruction methods, which all use it.
"""

from survey.reconstruction.prior.config import SatelliteErrors
from survey.reconstruction.prior.products import PRODUCTS, ErrorScale, PriorErrors

__all__ = ["PRODUCTS", "ErrorScale", "PriorErrors", "SatelliteErrors"]
