"""Errors and warnings of the libraries that read and write files."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


class DamagedError(ValueError):
    """Values that a library has read from a file in spite of damage."""


# What GDAL warns of and goes on with a value that the file does not hold.
_DAMAGE = ("parsed incompletely", "corrupt", "truncated", "unexpected end")


@contextmanager
def warnings_logged() -> Iterator[None]:
    """Send warnings of libraries that read a file to the log.

    Raises
    ------
    DamagedError
        A warning reports damage: the values that were read are not those of the file.
    """
    with warnings.catch_warnings(record=True) as caught, _unraisable_logged():
        warnings.simplefilter("always")
        yield
    for warning in caught:
        words = str(warning.message)
        if any(sign in words.lower() for sign in _DAMAGE):
            raise DamagedError(words)
        logging.getLogger(__name__).info("%s", words)


@contextmanager
def _unraisable_logged() -> Iterator[None]:
    """Send what a library cannot raise, such as a message that is no UTF-8, to the log instead of stderr."""
    before = sys.unraisablehook
    sys.unraisablehook = lambda fault: logging.getLogger(__name__).info("%s", fault.exc_value)
    try:
        yield
    finally:
        sys.unraisablehook = before


def first_line(reason: object) -> str:
    """Return the first line of a reason without its full stop, or the kind of fault where there are no words.

    Parameters
    ----------
    reason : object
        An exception or a text.

    Returns
    -------
    str
        One line without its full stop.
    """
    words = str(reason).strip()
    return words.splitlines()[0].rstrip(".") if words else type(reason).__name__
