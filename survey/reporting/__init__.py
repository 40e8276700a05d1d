"""The report of a survey: one HTML page that opens offline, with its figures inside."""

from survey.reporting.page import write_report
from survey.reporting.surveyed import OnBoard, Surveyed

__all__ = ["OnBoard", "Surveyed", "write_report"]
