"""Simulated and real terrain: random fields, landforms, ice micro-relief, and the satellite prior of it."""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
