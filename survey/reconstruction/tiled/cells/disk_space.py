"""Disk space that a map in tiles takes while it is made."""

import shutil
from pathlib import Path

from survey.core.errors import CapacityError

_BYTES_PER_POINT = 16
# Cells with their strips, solutions and maps of a tile, beside the sorted points.
_BYTES_PER_CELL = 90


def disk_bytes(n_points: int, n_cells: int) -> int:
    """Return the disk space that sorted points and cells take.

    Examples
    --------
    >>> disk_bytes(1_000_000_000, 100_000_000)
    25000000000
    """
    return n_points * _BYTES_PER_POINT + n_cells * _BYTES_PER_CELL


def require_disk(folder: Path, n_points: int, n_cells: int) -> int:
    """Return the disk space that the work takes, or refuse one that is not free.

    Parameters
    ----------
    folder : pathlib.Path
        An existing folder on the disk.
    n_points, n_cells : int
        Points of the survey and cells of the map.

    Returns
    -------
    int
        Bytes.

    Raises
    ------
    CapacityError
        Less space is free.
    """
    needed = disk_bytes(n_points, n_cells)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise CapacityError(
            f"the work takes {needed / 1e9:.3g} GB of disk for {n_points:,} points and {n_cells:,} cells, and {free / 1e9:.3g} GB "
            f"are free at {folder}; free space, or choose another disk with --out."
        )
    return needed
