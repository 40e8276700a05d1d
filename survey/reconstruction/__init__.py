"""Terrain reconstruction: from measured points to a map that states its own uncertainty."""

from survey.reconstruction.base import INTERPOLATED, MEASURED, RAY_BOUNDED, UNSEEN, Reconstruction
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.mean import ConstantMean, DemMean, FunctionMean, Mean
from survey.reconstruction.mapping import reconstruct
from survey.reconstruction.terrain_model import TerrainModel

__all__ = [
    "INTERPOLATED",
    "MEASURED",
    "RAY_BOUNDED",
    "UNSEEN",
    "ConstantMean",
    "DemMean",
    "FunctionMean",
    "GaussianProcessConfig",
    "GaussianProcessTerrain",
    "Mean",
    "Reconstruction",
    "TerrainModel",
    "reconstruct",
]
