"""Scores of a survey: coverage, spread, errors, calibration of the uncertainty, map class, and change."""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
