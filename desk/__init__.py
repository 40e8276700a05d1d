"""Planning desk: a page on the user's own machine to draw a survey and see its predicted error."""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
