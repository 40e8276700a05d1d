"""Files of real measurements: checked, and stored beside the plan."""

import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pyproj import CRS

from desk.plan.dropped import thinned_points
from survey.core.errors import ConfigError, InputError
from survey.core.files import replacing
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.scoring import Checkpoints

_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.-]+")
_MOST_LETTERS = 60


def store_measured(role: str, name: str, content: bytes, crs: CRS, folder: Path) -> dict[str, Any]:
    """Read a file of measurements, and store it where it can be read.

    Returns: ``file`` (its name there), ``kind`` and what the map shows of it.
    """
    if role not in _READERS:
        raise ConfigError(f"the role {role[:40]!r} is none of {', '.join(_READERS)}.")
    stored = _plain_name(name)
    with tempfile.TemporaryDirectory(prefix="firnline-desk-") as place:
        file = Path(place) / stored
        file.write_bytes(content)
        try:
            found = _READERS[role](file, crs)
        except InputError as error:
            raise InputError(str(error).replace(str(file), stored)) from error
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(folder / stored) as draft:
        draft.write_bytes(content)
    return {"file": stored, "role": role, **found}


def show_measured(role: str, file: Path, crs: CRS) -> dict[str, Any]:
    """Return what the map shows of a stored file; see `store_measured`."""
    return {"file": file.name, "role": role, **_READERS[role](file, crs)}


def read_checkpoints(file: Path, crs: CRS) -> Checkpoints:
    """Read checkpoints; heights without a stated uncertainty are taken to err by 0.05 m."""
    return Checkpoints.read(file, crs=crs, sigma_m=SIGMA_M)


SIGMA_M = 0.05
"""Standard deviation of heights that state none [m]."""


def _plain_name(name: str) -> str:
    """Return a name without folders and special letters."""
    bare = Path(name.replace("\\", "/")).name
    stem = _NOT_IN_NAMES.sub("-", Path(bare).stem)[:_MOST_LETTERS].strip("-._") or "measured"
    return f"{stem}{_NOT_IN_NAMES.sub('', Path(bare).suffix)[:10].lower()}"


def _points(file: Path, crs: CRS) -> dict[str, Any]:
    points = SurfacePoints.read(file, crs=crs, sigma_m=SIGMA_M)
    return {"kind": "points", **thinned_points(points.xyz)}


def _checkpoints(file: Path, crs: CRS) -> dict[str, Any]:
    return {"kind": "points", **thinned_points(read_checkpoints(file, crs).xyz)}


def _driven(file: Path, crs: CRS) -> dict[str, Any]:
    del crs
    route = Route.read(file)
    return {"kind": "lines", "lines": [leg.xy.round(2).tolist() for leg in route.legs]}


_READERS: dict[str, Callable[[Path, CRS], dict[str, Any]]] = {
    "points": _points,
    "checkpoints": _checkpoints,
    "driven": _driven,
}
