"""Figures of a survey: types in, `matplotlib.figure.Figure` out; no file is read or written.

Every figure has one style, states its units, and uses colours that the colour-blind can distinguish. Files are written by `survey.reporting`.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
