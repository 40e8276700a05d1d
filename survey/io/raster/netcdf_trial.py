"""Trial reading of NetCDF in another process with a time limit.

The NetCDF library crashes or does not return over rare damage, and a process that hangs in a library cannot be
interrupted from within. `refuse_unreadable` therefore starts this file as a script, which reads the NetCDF file first:
``python netcdf_trial.py FILE LARGEST_CELLS LARGEST_KIB``. As a script it imports nothing of the project, because every NetCDF file
waits for it. It also finds values that a NetCDF-4 file takes from other files.
"""

import subprocess
import sys
from pathlib import Path
from typing import Any

_PATIENCE_S = 10.0
_SLOWEST_BYTES_PER_S = 5e6
# Exit codes of the script; the interpreter itself uses 1 and 2.
_OUTSIDE, _WITHOUT_H5PY, _TOO_LARGE = 31, 32, 33
# Three times what the largest raster and its blocks take: damaged headers make the library take more.
_LARGEST_KIB = 1_500_000
_HDF5 = b"\x89HDF"


def refuse_unreadable(file: Path, largest_cells: int) -> None:
    """Let another process read a NetCDF file first, with a time limit; what it merely refuses is judged by the caller.

    It costs some 0.5 s. Variables of more than `largest_cells` cells are not read through.
    """
    from survey.core.errors import InputError  # here: the script does without the project

    patience_s = _PATIENCE_S + file.stat().st_size / _SLOWEST_BYTES_PER_S
    # By the path of this file, not by -m, which would import the package first; -P keeps this folder off sys.path.
    command = [sys.executable, "-P", __file__, str(file.absolute()), str(largest_cells), str(_LARGEST_KIB)]
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
    if done.returncode == _TOO_LARGE:
        raise InputError(
            f"{file} is damaged (its header claims more memory than its cells take); get it again."
        )
    if done.returncode == _OUTSIDE:
        raise InputError(f"{file} takes values from other files; write them into it (nccopy does it).")
    if done.returncode == _WITHOUT_H5PY:
        raise InputError(
            f"{file} is NetCDF-4, and to check it h5py is needed, which is not installed; install firnline[netcdf]."
        )


def _leads_outside(name: str) -> bool:
    """Return whether a NetCDF-4 file takes values from other files; the older kinds cannot."""
    with Path(name).open("rb") as file:
        if file.read(len(_HDF5)) != _HDF5:
            return False
    try:
        import h5py
    except ImportError:
        sys.exit(_WITHOUT_H5PY)
    with h5py.File(name, "r") as file:
        return _group_leads_outside(h5py, file, set())


def _group_leads_outside(h5py: Any, group: Any, seen: set[Any]) -> bool:
    """Return whether a group or one below it holds an external link, or a data set stored in other files.

    `seen` collects the groups that were entered, because hard links may form a circle.
    """
    for key in group:
        if isinstance(group.get(key, getlink=True), h5py.ExternalLink):
            return True
        item = group.get(key)
        if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
            return True
        if isinstance(item, h5py.Group) and item.id not in seen:
            seen.add(item.id)
            if _group_leads_outside(h5py, item, seen):
                return True
    return False


def _read(name: str, largest_cells: int) -> None:
    """Read all variables of at most `largest_cells` cells, block by block."""
    import rasterio

    with rasterio.open(name, driver="netCDF") as source:
        source.tags()
        parts = source.subdatasets
        for band in range(1, source.count + 1):
            if source.width * source.height <= largest_cells:
                for _, window in source.block_windows(band):
                    source.read(band, window=window)
    for part in parts:
        _read(part, largest_cells)


def _peak_kib() -> int:
    """Return the peak of this process's memory [KiB]; 0 where the system has no such record.

    That of `resource.getrusage` will not do: a new process begins with the peak of the one that started it.
    """
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="ascii").splitlines() if status.is_file() else []
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), 0)


if __name__ == "__main__":
    if _leads_outside(sys.argv[1]):
        sys.exit(_OUTSIDE)
    try:
        _read(sys.argv[1], int(sys.argv[2]))
    finally:
        if _peak_kib() > int(sys.argv[3]):
            sys.exit(_TOO_LARGE)
