"""Public names and the modules that define them."""

from survey.data.ice_motion import IceMotion as IceMotion
from survey.data.sensors.stakes import read_stake_surveys as read_stake_surveys
from survey.reconstruction.gp.config import GaussianProcessConfig as GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain as GaussianProcessTerrain
from survey.reconstruction.gp.mean import ConstantMean as ConstantMean
from survey.reconstruction.gp.mean import DemMean as DemMean
from survey.reconstruction.gp.mean import FunctionMean as FunctionMean
from survey.reconstruction.gp.mean import Mean as Mean
from survey.reconstruction.mapping import reconstruct as reconstruct
from survey.reconstruction.motion.priors import VelocityRasters as VelocityRasters
from survey.reconstruction.motion.priors import motion_from_rasters as motion_from_rasters
from survey.reconstruction.motion.priors import motion_from_slope as motion_from_slope
from survey.reconstruction.motion.priors import uniform_motion as uniform_motion
from survey.reconstruction.motion.refinement import area_mean as area_mean
from survey.reconstruction.motion.refinement import refined_motion as refined_motion
from survey.reconstruction.motion.stakes import predict_position as predict_position
from survey.reconstruction.terrain_map import INTERPOLATED as INTERPOLATED
from survey.reconstruction.terrain_map import MEASURED as MEASURED
from survey.reconstruction.terrain_map import RAY_BOUNDED as RAY_BOUNDED
from survey.reconstruction.terrain_map import UNSEEN as UNSEEN
from survey.reconstruction.terrain_map import Reconstruction as Reconstruction
from survey.reconstruction.terrain_model import TerrainModel as TerrainModel
