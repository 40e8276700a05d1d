"""Maps of runs as layers: elevation, standard deviation, support, error, difference of two runs."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pyproj import CRS

from desk.terrain.palette import DEVIATION, ELEVATION, ERROR, SUPPORT
from desk.terrain.pictures import picture
from sim.mission.fleet import drive_folders
from survey.core.crs import same_crs
from survey.core.errors import InputError
from survey.core.run_folder import RunFolder
from survey.core.text import round_number
from survey.data.dem import Dem
from survey.data.truth import Truth
from survey.reconstruction.terrain_map import MEASURED, SUPPORT_NAMES, Reconstruction


def run_layer(run: RunFolder, layer: str, crs: CRS) -> dict[str, Any]:
    """Return a map of a run as a picture.

    Returns: a `desk.terrain.pictures.picture` with a ``title`` and the texts of both ``ends``.
    """
    if layer not in _LAYERS:
        raise InputError(f"the layer {layer[:40]!r} is none of {', '.join(_LAYERS)}.")
    map_ = Reconstruction.read(run.folder("reconstruct"))
    same_crs(crs, map_.mean.crs, "the desk and the run")
    return _LAYERS[layer](run, map_)


def difference_layer(one: RunFolder, other: RunFolder, crs: CRS) -> dict[str, Any]:
    """Return the map of one run minus that of another one as a picture.

    Returns: as for `run_layer`, with the root mean square ``rms_m`` of the difference.
    """
    first, second = (Reconstruction.read(run.folder("reconstruct")).mean for run in (one, other))
    for map_ in (first, second):
        same_crs(crs, map_.crs, "the desk and the run")
    values = first.elevation - second.at(first.xy).reshape(first.shape)
    if not np.isfinite(values).any():
        raise InputError("the maps of the two runs have no ground in common; choose runs of one area.")
    rms_m = float(np.sqrt(np.nanmean(values**2)))
    return _signed(Dem.on(first.grid(), values), "Difference of the maps") | {"rms_m": rms_m}


def map_layers(map_: Reconstruction) -> dict[str, dict[str, Any]]:
    """Return elevation and standard deviation of a map as pictures.

    Returns: ``elevation`` and ``sigma``, as for `run_layer`.
    """
    return layers_of(map_.mean, map_.std)


def layers_of(mean: Dem, std: Dem) -> dict[str, dict[str, Any]]:
    """Return elevation and standard deviation as pictures.

    `mean`, `std`: heights and their standard deviations [m]. Returns: ``elevation`` and ``sigma``, as for
    `run_layer`.
    """
    return {"elevation": _elevation(mean), "sigma": _sigma(std)}


def _elevation(mean: Dem) -> dict[str, Any]:
    low, high = (float(limit) for limit in np.nanpercentile(mean.elevation, [1.0, 99.0]))
    ends = [f"{low:.1f} m", f"{high:.1f} m"]
    return picture(mean, ELEVATION, low, high) | {"title": "Elevation of the map", "ends": ends}


def _sigma(std: Dem) -> dict[str, Any]:
    top = round_number(max(float(np.nanpercentile(std.elevation, 98.0)) * 1.1, 1e-3))
    ends = ["0 m", f"{top:g} m or more"]
    return picture(std, DEVIATION, 0.0, top) | {"title": "Standard deviation of the map", "ends": ends}


def _support(map_: Reconstruction) -> dict[str, Any]:
    raster = Dem.on(map_.mean.grid(), np.asarray(map_.support, dtype=np.float64))
    ends = [SUPPORT_NAMES[0].lower(), SUPPORT_NAMES[MEASURED].lower()]
    return picture(raster, SUPPORT, 0.0, float(MEASURED)) | {"title": "Support of the map", "ends": ends}


def _error(run: RunFolder, map_: Reconstruction) -> dict[str, Any]:
    truth = Truth.read(drive_folders(run.folder("simulate"))[0] / "truth").dem
    values = map_.mean.elevation - truth.at(map_.mean.xy).reshape(map_.mean.shape)
    return _signed(Dem.on(map_.mean.grid(), values), "Error of the map")


def _signed(raster: Dem, title: str) -> dict[str, Any]:
    """Return a picture in colours about zero."""
    top = round_number(max(float(np.nanpercentile(np.abs(raster.elevation), 98.0)), 1e-3))
    ends = [f"−{top:g} m or less", f"+{top:g} m or more"]
    return picture(raster, ERROR, -top, top) | {"title": title, "ends": ends}


_LAYERS: dict[str, Callable[[RunFolder, Reconstruction], dict[str, Any]]] = {
    "error": _error,
    "sigma": lambda _, map_: _sigma(map_.std),
    "elevation": lambda _, map_: _elevation(map_.mean),
    "support": lambda _, map_: _support(map_),
}
