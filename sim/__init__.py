"""Simulator of firnline: worlds, sensors and vehicles, missions, Monte Carlo studies.

Estimation and planning live in `survey`, `planners` and `vision_slam`, which never import this package.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
