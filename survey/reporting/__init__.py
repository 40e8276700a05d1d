"""The report of a survey: one HTML page that opens offline, with its figures inside."""

from survey.reporting.page import write_report

__all__ = ["write_report"]
