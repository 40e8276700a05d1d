"""Public names and the modules that define them."""

from survey.reconstruction.gp.config import GaussianProcessConfig as GaussianProcessConfig
from survey.reconstruction.lattice.free_lattice import beam_covariance as beam_covariance
from survey.reconstruction.lattice.free_lattice import free_lattice as free_lattice
from survey.reconstruction.lattice.free_surface import FreeSurface as FreeSurface
from survey.reconstruction.mapping import reconstruct as reconstruct
from survey.reconstruction.terrain_map import Reconstruction as Reconstruction
