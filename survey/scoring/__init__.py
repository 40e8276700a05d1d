"""Scores of a survey: coverage, spread, errors, calibration of the uncertainty, map class, and change."""

from survey.scoring.accuracy import Calibration, ErrorStatistics
from survey.scoring.change.along_flow import Thickness
from survey.scoring.change.change import change
from survey.scoring.change.coregistration import Shift, coregister
from survey.scoring.change.models import change_of_models
from survey.scoring.change.results import AlongFlow, Change, FlowBalance, MassBalance, VolumeChange
from survey.scoring.coverage import Coverage, SampleCells, science_coverage
from survey.scoring.motion.displacements import RasterField, SteadyField, TrackedField
from survey.scoring.motion.tracking import TrackedMotion, track
from survey.scoring.score import Score, score
from survey.scoring.spread import centeredness, distribution
from survey.scoring.standards.assessment import CheckpointScore, score_at
from survey.scoring.standards.certificate import Certificate, certificate
from survey.scoring.standards.checkpoint_design import design_checkpoints
from survey.scoring.standards.checkpoint_errors import CheckpointErrors, Spread, compare
from survey.scoring.standards.checkpoints import Checkpoints
from survey.scoring.standards.findings import Assessment
from survey.scoring.standards.intervals import RmseInterval
from survey.scoring.standards.map_classes import (
    MapClass,
    Verdict,
    judge,
    map_classes,
)
from survey.scoring.standards.standards import Standard

__all__ = [
    "AlongFlow",
    "Assessment",
    "Calibration",
    "Certificate",
    "Change",
    "CheckpointErrors",
    "CheckpointScore",
    "Checkpoints",
    "Coverage",
    "ErrorStatistics",
    "FlowBalance",
    "MapClass",
    "MassBalance",
    "RasterField",
    "RmseInterval",
    "SampleCells",
    "Score",
    "Shift",
    "Spread",
    "Standard",
    "SteadyField",
    "Thickness",
    "TrackedField",
    "TrackedMotion",
    "Verdict",
    "VolumeChange",
    "centeredness",
    "certificate",
    "change",
    "change_of_models",
    "compare",
    "coregister",
    "design_checkpoints",
    "distribution",
    "judge",
    "map_classes",
    "science_coverage",
    "score",
    "score_at",
    "track",
]
