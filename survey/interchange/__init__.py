"""Conversion between the survey's data types and the files of other programs.

Route exports, scan readers and dataset layouts live here; formats that know no data type live in `survey.io`.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
