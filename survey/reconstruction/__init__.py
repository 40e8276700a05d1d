"""Terrain reconstruction: from measured points to a map that states its own uncertainty."""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
