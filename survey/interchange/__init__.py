"""Conversion between the survey's data types and the files of other programs.

Route exports, scan readers and dataset layouts live here; formats that know no data type live in `survey.io`.
"""

from survey.interchange.convert import convert
from survey.interchange.route_formats import read_plan, write_plan

__all__ = ["convert", "read_plan", "write_plan"]
