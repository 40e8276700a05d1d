"""Surveys while they are driven: missions of rovers over MAVLink, and the map as measurements arrive."""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
