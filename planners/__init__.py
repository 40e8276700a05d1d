"""Route planning: patterns of swaths, their choice by predicted error, and steering while driving.

Data types live in `survey`; this package neither localizes nor simulates.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
