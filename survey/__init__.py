"""Data types of a survey, file formats, terrain reconstruction, scoring, figures and reports.

Route planning lives in `planners`, localization in `vision_slam`, simulation in `sim`.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
