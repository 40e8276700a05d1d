"""Exceptions of firnline, and the exit codes with which the command line ends.

Every message is one sentence: what was found, where, what was expected and what to do.
"""


class FirnlineError(Exception):
    """Root of every error that firnline raises on purpose."""

    exit_code = 1


class InputError(FirnlineError, ValueError):
    """Data that cannot be used: a file, a raster, an area, a set of points."""

    exit_code = 3


class CapacityError(InputError):
    """A task that would not fit the memory that it may use."""


class ConfigError(FirnlineError, ValueError):
    """A setting that is unknown, out of range or at odds with another one."""

    exit_code = 4
