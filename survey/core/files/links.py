"""Resolution of symbolic links."""

import os
from pathlib import Path


def resolved(path: str | Path) -> Path:
    """Return the absolute path without symbolic links; links that lead around in a circle stay.

    Parameters
    ----------
    path : str or pathlib.Path
        Existing or not.

    Returns
    -------
    pathlib.Path
        Unlike `pathlib.Path.resolve`, a circle of links raises nothing; opening the path then fails.

    Examples
    --------
    >>> resolved("/usr/../usr").name
    'usr'
    """
    return Path(os.path.realpath(path))
