"""Trial reading of NetCDF files by another process, for over rare damage their library does not return."""

import subprocess
import sys
from pathlib import Path

from survey.core.errors import InputError

_PATIENCE_S = 10.0
_SLOWEST_BYTES_PER_S = 5e6
_OUTSIDE, _WITHOUT_H5PY = 31, 32
_READ_THROUGH = f"""
import sys
import rasterio

def leads_outside(name):
    with open(name, "rb") as file:
        if file.read(4) != b"\\x89HDF":
            return False
    try:
        import h5py
    except ImportError:
        sys.exit({_WITHOUT_H5PY})
    with h5py.File(name, "r") as file:
        return group_leads_outside(h5py, file, set())

def group_leads_outside(h5py, group, seen):
    for key in group:
        if isinstance(group.get(key, getlink=True), h5py.ExternalLink):
            return True
        item = group.get(key)
        if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
            return True
        if isinstance(item, h5py.Group) and item.id not in seen:
            seen.add(item.id)
            if group_leads_outside(h5py, item, seen):
                return True
    return False

def read(name, largest):
    with rasterio.open(name, driver="netCDF") as source:
        source.tags()
        parts = source.subdatasets
        for band in range(1, source.count + 1):
            if source.width * source.height <= largest:
                for _, window in source.block_windows(band):
                    source.read(band, window=window)
    for part in parts:
        read(part, largest)

if leads_outside(sys.argv[1]):
    sys.exit({_OUTSIDE})
read(sys.argv[1], int(sys.argv[2]))
"""


def refuse_unreadable(file: Path, largest_cells: int) -> None:
    """Let another process read a NetCDF file first, with a time limit; what it merely refuses is judged by the caller.

    It costs some 0.5 s: a process that hangs in a library cannot be interrupted from within.
    Variables of more than `largest_cells` cells are not read through.

    Parameters
    ----------
    file : pathlib.Path
        A NetCDF file.
    largest_cells : int
        Variables of more cells are not read through.

    Raises
    ------
    InputError
        The library does not come to an end over this file, or crashes; the file takes values from other
        files; it is HDF5 and h5py is not installed to find that out.
    """
    patience_s = _PATIENCE_S + file.stat().st_size / _SLOWEST_BYTES_PER_S
    command = [sys.executable, "-c", _READ_THROUGH, str(file.absolute()), str(largest_cells)]
    try:
        done = subprocess.run(
            command,
            timeout=patience_s,
            check=False,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired as endless:
        raise InputError(
            f"{file} is damaged (reading it did not end within {patience_s:.0f} s); get it again."
        ) from endless
    _judge(file, done.returncode)


def _judge(file: Path, code: int) -> None:
    if code < 0:
        raise InputError(f"{file} is damaged (its library crashes over it); get it again.")
    if code == _OUTSIDE:
        raise InputError(f"{file} takes values from other files; write them into it (nccopy does it).")
    if code == _WITHOUT_H5PY:
        raise InputError(
            f"{file} is NetCDF-4, and to check it h5py is needed, which is not installed; install firnline[netcdf]."
        )
