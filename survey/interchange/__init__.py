"""Conversion between the survey's data types and the files of other programs.

Route exports, scan readers and dataset layouts live here; formats that know no data type live in `survey.io`.
"""

from survey.interchange.conversion import convert
from survey.interchange.route_formats import read_plan, write_plan
from survey.interchange.tum_euroc import write_euroc
from survey.io.trajectory_files import read_kitti

__all__ = ["convert", "read_kitti", "read_plan", "write_euroc", "write_plan"]
