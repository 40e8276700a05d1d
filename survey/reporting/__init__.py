"""Report of a survey: one HTML page that opens offline, with its figures embedded.

Figures are drawn by `survey.figures`; scores are computed by `survey.scoring`.
"""

from survey.reporting.page import write_report
from survey.reporting.survey_results import (
    FleetResults,
    HazardResults,
    OnBoard,
    PayloadResults,
    RoverDrive,
    SurveyResults,
)

__all__ = [
    "FleetResults",
    "HazardResults",
    "OnBoard",
    "PayloadResults",
    "RoverDrive",
    "SurveyResults",
    "write_report",
]
