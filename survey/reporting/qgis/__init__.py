"""QGIS projects: styled layers in groups, with relative paths."""

from survey.reporting.qgis.layers import QgisGroup, QgisLayer, value_limits
from survey.reporting.qgis.project import write_project

__all__ = ["QgisGroup", "QgisLayer", "value_limits", "write_project"]
