"""Checks of the installation and the machine, as ``firnline doctor`` prints them.

Memory, disk, threads, fonts, caches, transformation grids, packages and the physics engine.
"""

import os
import platform
import shutil
import tempfile
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement


class Finding(NamedTuple):
    """What was checked, what was found, whether it is well, and what does not run where it is not."""

    what: str
    found: str
    is_well: bool = True
    prevents: str = ""


MEMORY_GIB = 2.0
"""Memory that the demos need at least [GiB]."""
DISK_GIB = 0.5
"""Free space that the demos need at least [GiB]."""
_GIB = 2**30


def machine_findings() -> list[Finding]:
    """Check what the demos need of the machine."""
    return [
        Finding("cores", str(os.cpu_count())),
        memory_finding(_memory_bytes()),
        disk_finding(shutil.disk_usage(".").free),
        _folder_finding(),
        _temporary_finding(),
        _threads(),
        _fonts(),
        _compiled_cache(),
    ]


def memory_finding(size_bytes: float) -> Finding:
    """Compare the memory with what the demos need."""
    is_enough = size_bytes >= MEMORY_GIB * _GIB
    needed = "" if is_enough else f"; the demos need {MEMORY_GIB:g} GiB"
    lost = "" if is_enough else "the demos, and maps of large areas"
    return Finding("memory", f"{size_bytes / _GIB:.1f} GiB{needed}", is_enough, lost)


def disk_finding(free_bytes: float) -> Finding:
    """Compare the free space of this folder with what the demos write."""
    is_enough = free_bytes >= DISK_GIB * _GIB
    needed = "" if is_enough else f"; the demos need {DISK_GIB:g} GiB, free space or set --runs"
    return Finding(
        "disk", f"{free_bytes / _GIB:.1f} GiB free{needed}", is_enough, "" if is_enough else "the demos"
    )


def _memory_bytes() -> float:
    """Return the memory of the machine, or of the container where that is less."""
    size = float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    limit = Path("/sys/fs/cgroup/memory.max")
    text = limit.read_text(encoding="ascii").strip() if limit.is_file() else "max"
    return min(size, float(text)) if text.isdigit() else size


def _folder_finding() -> Finding:
    if os.access(".", os.W_OK):
        return Finding("this folder", "can be written to")
    return Finding("this folder", "is read-only; runs need --runs")


def _temporary_finding() -> Finding:
    folder = tempfile.gettempdir()
    if os.access(folder, os.W_OK):
        return Finding("temporary files", folder)
    return Finding(
        "temporary files", f"{folder} is read-only; set TMPDIR", is_well=False, prevents="tests and studies"
    )


def _threads() -> Finding:
    """State the threads of the linear algebra; more than cores slow everything down."""
    import numpy  # noqa: F401  (loads the library whose threads are counted)
    from threadpoolctl import threadpool_info

    n = max((int(pool["num_threads"]) for pool in threadpool_info()), default=1)
    if n <= (os.cpu_count() or 1):
        return Finding("threads", str(n))
    return Finding("threads", f"{n}, more than cores, which is slow; set OPENBLAS_NUM_THREADS")


def _fonts() -> Finding:
    """Check that matplotlib's list holds the fonts that it brings; firnline adds those that lack, other programs do not."""
    import matplotlib

    from survey.figures.style import unlisted_fonts

    brought = Path(matplotlib.get_data_path(), "fonts", "ttf")
    if not (brought / "DejaVuSans.ttf").is_file():
        return Finding(
            "fonts", "DejaVu Sans is missing; install matplotlib again", is_well=False, prevents="figures"
        )
    missing = unlisted_fonts()
    if not missing:
        return Finding("fonts", f"{len(list(brought.glob('*.ttf')))} of matplotlib")
    lists = ", ".join(map(str, sorted(Path(matplotlib.get_cachedir()).glob("fontlist-*.json"))))
    return Finding(
        "fonts",
        f"matplotlib's list lacks {len(missing)} of its own, such as {missing[-1].stem}; delete {lists}",
    )


def _compiled_cache() -> Finding:
    """Check that compiled loops can be stored; without that every start compiles for a minute."""
    import sim.rendering

    beside = Path(next(iter(sim.rendering.__path__))) / "__pycache__"
    named = os.environ.get("NUMBA_CACHE_DIR")
    own = Path.home() / ".cache" / "numba"
    is_kept = named and not Path(named).name.startswith("firnline-compiled-")  # which this process alone uses
    places = [Path(named)] if named and is_kept else [beside, beside.parent, own, *own.parents[:2]]
    place = next((it for it in places if it.is_dir() and os.access(it, os.W_OK)), None)
    if place is not None:
        return Finding("compiled loops", f"stored in {place}")
    return Finding(
        "compiled loops", "cannot be stored, and every start compiles for a minute; set NUMBA_CACHE_DIR"
    )


def library_findings() -> list[Finding]:
    """State the versions of GDAL and PROJ, and which vertical datums can be transformed."""
    import pyproj
    import rasterio

    from survey.core.transformation import lacking_grids

    datums = [
        Finding(
            datum,
            f"no grid: {', '.join(missing)}; heights stay in the datum of their file" if missing else "grid is here",
        )
        for datum, missing in lacking_grids().items()
    ]  # fmt: skip
    return [Finding("GDAL", rasterio.__gdal_version__), Finding("PROJ", pyproj.proj_version_str), *datums]


# Modules of the optional extras, with what needs them.
_EXTRAS = {
    "rosbags": ("bags", "ROS bags are not read"),
    "h5netcdf": ("netcdf", "NetCDF maps are not written"),
    "xarray": ("notebook", "to_xarray is not available"),
    "distributed": ("cluster", "Monte Carlo studies run on this machine alone"),
}
_EVERYTHING = "firnline"


def package_findings() -> list[Finding]:
    """Check the required packages by their versions."""
    rows = [Finding("Python", platform.python_version())]
    for line in requires("firnline") or []:
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            rows.append(_required(requirement))
    return rows


def _required(requirement: Requirement) -> Finding:
    name = requirement.name
    try:
        found = version(name)
    except PackageNotFoundError:
        return Finding(name, "missing; install firnline again", is_well=False, prevents=_EVERYTHING)
    if requirement.specifier.contains(found, prereleases=True):
        return Finding(name, found)
    wanted = f"{found}, and {requirement.specifier} is needed; install firnline again"
    return Finding(name, wanted, is_well=False, prevents=_EVERYTHING)


def extra_findings() -> list[Finding]:
    """State which optional packages are there; none is a fault."""
    return [
        Finding(module, "installed" if find_spec(module) else f"not installed: {lost} (pip install 'firnline[{extra}]')")
        for module, (extra, lost) in _EXTRAS.items()
    ]  # fmt: skip


def physics_finding() -> Finding:
    """Check whether a rigid-body engine can be imported."""
    from sim.vehicle.rigid_bodies import choose_physics
    from survey.core.errors import ConfigError

    try:
        return Finding("physics engine", choose_physics("contact"))
    except ConfigError as error:
        return Finding(
            "physics engine",
            str(error),
            is_well=False,
            prevents="the second demo (short_drive) and other drives of the fidelity vision",
        )
