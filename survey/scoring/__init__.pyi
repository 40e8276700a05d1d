"""Public names and the modules that define them."""

from survey.scoring.accuracy import Calibration as Calibration
from survey.scoring.accuracy import ErrorStatistics as ErrorStatistics
from survey.scoring.coverage import Coverage as Coverage
from survey.scoring.differencing.difference import change as change
from survey.scoring.differencing.m3c2 import CloudDistances as CloudDistances
from survey.scoring.differencing.m3c2 import m3c2 as m3c2
from survey.scoring.differencing.volume_change import Change as Change
from survey.scoring.scores import Score as Score
from survey.scoring.scores import score as score
from survey.scoring.standards.assessment import CheckpointScore as CheckpointScore
from survey.scoring.standards.assessment import score_at as score_at
from survey.scoring.standards.checkpoint_errors import CheckpointErrors as CheckpointErrors
from survey.scoring.standards.checkpoint_errors import compare as compare
from survey.scoring.standards.checkpoints import Checkpoints as Checkpoints
from survey.scoring.standards.checkpoints import design_checkpoints as design_checkpoints
from survey.scoring.standards.map_classes import Certificate as Certificate
from survey.scoring.standards.map_classes import certificate as certificate
from survey.scoring.standards.map_classes import map_classes as map_classes
