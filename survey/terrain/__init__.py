"""Simulated and real terrain: random fields, landforms, ice micro-relief, and the satellite prior of it."""

from survey.terrain.random_fields import matern_field
from survey.terrain.satellite import satellite_copy
from survey.terrain.synthetic import ice_micro_relief, random_dem

__all__ = ["ice_micro_relief", "matern_field", "random_dem", "satellite_copy"]
