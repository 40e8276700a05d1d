"""Scores of a survey: coverage, spread, errors, calibration of the uncertainty, map class, and change."""

from survey.scoring.accuracy import Calibration, ErrorStatistics
from survey.scoring.change.difference import change
from survey.scoring.change.volume_change import Change
from survey.scoring.coverage import Coverage
from survey.scoring.scores import Score, score
from survey.scoring.standards.assessment import CheckpointScore, score_at
from survey.scoring.standards.checkpoint_errors import CheckpointErrors, compare
from survey.scoring.standards.checkpoints import Checkpoints, design_checkpoints
from survey.scoring.standards.map_classes import Certificate, certificate, map_classes

__all__ = [
    "Calibration", "Certificate", "Change", "CheckpointErrors", "CheckpointScore", "Checkpoints",
    "Coverage", "ErrorStatistics", "Score", "certificate", "change", "compare", "design_checkpoints",
    "map_classes", "score", "score_at",
]  # fmt: skip
