"""Public names and the modules that define them."""

from survey.reconstruction.base import INTERPOLATED as INTERPOLATED
from survey.reconstruction.base import MEASURED as MEASURED
from survey.reconstruction.base import RAY_BOUNDED as RAY_BOUNDED
from survey.reconstruction.base import UNSEEN as UNSEEN
from survey.reconstruction.base import Reconstruction as Reconstruction
from survey.reconstruction.gp.config import GaussianProcessConfig as GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain as GaussianProcessTerrain
from survey.reconstruction.gp.mean import ConstantMean as ConstantMean
from survey.reconstruction.gp.mean import DemMean as DemMean
from survey.reconstruction.gp.mean import FunctionMean as FunctionMean
from survey.reconstruction.gp.mean import Mean as Mean
from survey.reconstruction.mapping import reconstruct as reconstruct
from survey.reconstruction.terrain_model import TerrainModel as TerrainModel
