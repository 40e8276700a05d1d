"""Public names and the modules that define them."""

from planners.costs import FieldWork as FieldWork
from planners.costs import Rates as Rates
from planners.patterns.best import BestConfig as BestConfig
from planners.patterns.lawnmower import LawnmowerConfig as LawnmowerConfig
from planners.patterns.piecewise_continuous import PiecewiseContinuousConfig as PiecewiseContinuousConfig
from planners.patterns.random_wander import RandomWanderConfig as RandomWanderConfig
from planners.patterns.variance_driven import VarianceDrivenConfig as VarianceDrivenConfig
from planners.patterns.wavy import WavyConfig as WavyConfig
from planners.planning import plan as plan
from planners.planning import prior_model as prior_model
from planners.prediction.assumptions import MapAssumptions as MapAssumptions
from planners.prediction.error_model import ErrorModel as ErrorModel
from planners.prediction.error_model import predict_error as predict_error
from planners.prediction.prior_kernels import terrain_kernel as terrain_kernel
from planners.routes.rover import Fleet as Fleet
from planners.routes.rover import Rover as Rover
