"""NetCDF files are HDF5 files, and over rare damage to its records that library loops for ever or crashes."""

import subprocess
import sys
from pathlib import Path

from survey.core.errors import InputError

_PATIENCE_S = 10.0
_SLOWEST_BYTES_PER_S = 5e6
_READ_THROUGH = """
import sys
import rasterio

def read(name):
    with rasterio.open(name) as source:
        source.tags()
        for band in range(1, source.count + 1):
            for _, window in source.block_windows(band):
                source.read(band, window=window)
        for part in source.subdatasets:
            read(part)

read(sys.argv[1])
"""


def refuse_endless(file: Path) -> None:
    """Let another process read the file first, with a time limit; what it merely refuses is judged by the caller.

    It costs some 0.4 s: a process that hangs in a library cannot be interrupted from within.

    Raises
    ------
    InputError
        The library does not come to an end over this file, or crashes.
    """
    patience_s = _PATIENCE_S + file.stat().st_size / _SLOWEST_BYTES_PER_S
    command = [sys.executable, "-c", _READ_THROUGH, str(file)]
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
    if done.returncode < 0:
        raise InputError(f"{file} is damaged (its library crashes over it); get it again.")
