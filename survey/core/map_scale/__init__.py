"""Local scale factors of map projections, and lengths and areas on the ground.

Transformations between coordinate reference systems live beside this folder, in `survey.core.crs`.
"""

from survey.core.map_scale.factors import MapScale, ScaleFactors, ScaleRange, scale_factors
from survey.core.map_scale.ground import areal_factors, ground_area_m2, ground_length_m, ground_lengths_m

__all__ = [
    "MapScale",
    "ScaleFactors",
    "ScaleRange",
    "areal_factors",
    "ground_area_m2",
    "ground_length_m",
    "ground_lengths_m",
    "scale_factors",
]
