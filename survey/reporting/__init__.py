"""The report of a survey: one HTML page that opens offline, with its figures inside."""

from survey.reporting.page import write_report
from survey.reporting.surveyed import OnBoard, SurveyResults

__all__ = ["OnBoard", "SurveyResults", "write_report"]
