"""Plan sheets for printing: an overview, the predicted standard deviation, and one sheet for each rover, on A4 pages."""

from survey.figures.sheets.content import PlanContent, RoverEffort
from survey.figures.sheets.pages import pdf_bytes, plan_sheets

__all__ = ["PlanContent", "RoverEffort", "pdf_bytes", "plan_sheets"]
