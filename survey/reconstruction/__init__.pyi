"""Public names and the modules that define them."""

from survey.reconstruction.gp.config import GaussianProcessConfig as GaussianProcessConfig
from survey.reconstruction.mapping import reconstruct as reconstruct
from survey.reconstruction.terrain_map import Reconstruction as Reconstruction
