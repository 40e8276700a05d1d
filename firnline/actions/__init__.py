"""Actions of firnline: one function for each capability, which reads, checks, computes and returns a result.

A request names files and settings, as the options of a command do. The result writes files by ``write``, and states what was
found by ``lines`` and ``facts``. The command line and the planning desk adapt these functions and decide nothing about data.
Names are imported when they are first used; they are listed in ``__init__.pyi``.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
