"""Public names and the modules that define them."""

from survey.terrain.random_fields import matern_field as matern_field
from survey.terrain.satellite import satellite_copy as satellite_copy
from survey.terrain.synthetic import ice_micro_relief as ice_micro_relief
from survey.terrain.synthetic import random_dem as random_dem
