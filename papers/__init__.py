"""Figures and tables of the three papers: one study each, listed in `studies`, run by ``firnline reproduce``."""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
