"""How good a survey was: coverage, spread, errors, honesty of the uncertainty, class of the map."""

from survey.scoring.accuracy import Calibration, ErrorStatistics
from survey.scoring.coverage import Coverage, SampleCells, science_coverage
from survey.scoring.score import Score, score
from survey.scoring.spread import centeredness, distribution
from survey.scoring.standards import MapClass, Verdict, judge, map_classes

__all__ = [
    "Calibration",
    "Coverage",
    "ErrorStatistics",
    "MapClass",
    "SampleCells",
    "Score",
    "Verdict",
    "centeredness",
    "distribution",
    "judge",
    "map_classes",
    "science_coverage",
    "score",
]
