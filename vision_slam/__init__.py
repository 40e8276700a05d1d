"""Localization of a rover from its recording: visual odometry, sensor fusion, loop closures.

The truth of a simulation never reaches this package.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
