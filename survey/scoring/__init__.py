"""Scores of a survey: coverage, spread, errors, calibration of the uncertainty, map class, and change."""

from survey.scoring.accuracy import Calibration, ErrorStatistics
from survey.scoring.change.along_flow import Thickness
from survey.scoring.change.coregistration import Shift, coregister
from survey.scoring.change.difference import change, change_of_models
from survey.scoring.change.displacements import RasterField, SteadyField, TrackedField
from survey.scoring.change.tracking import TrackedMotion, track
from survey.scoring.change.volume_change import AlongFlow, Change, FlowBalance, MassBalance, VolumeChange
from survey.scoring.coverage import Coverage, SampleCells, centeredness, distribution, science_coverage
from survey.scoring.scores import Score, score
from survey.scoring.standards.assessment import Assessment, CheckpointScore, score_at
from survey.scoring.standards.checkpoint_errors import CheckpointErrors, RmseInterval, Spread, compare
from survey.scoring.standards.checkpoints import Checkpoints, design_checkpoints
from survey.scoring.standards.map_classes import (
    Certificate,
    MapClass,
    Verdict,
    certificate,
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
