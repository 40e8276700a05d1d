"""Files that are dropped onto the page: outlines, rasters, points."""

import base64
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from desk.plan.document import PlanDocument
from desk.terrain.palette import ELEVATION, colour_of, legend_colours
from desk.terrain.tiles import png_bytes
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.surface_points import SurfacePoints

_OUTLINES = (".geojson", ".json", ".gpkg", ".kml", ".kmz", ".fgb")
_RASTERS = (".tif", ".tiff", ".asc", ".hgt", ".nc")
_POINTS = (".csv", ".las", ".laz", ".ply")
_MOST_PIXELS = 1024
_MOST_POINTS = 5000


def dropped(name: str, content: bytes, crs: CRS) -> dict[str, Any]:
    """Return what a dropped file holds, in the CRS of the terrain.

    Parameters
    ----------
    name : str
        Name of the file; its ending says what it is.
    content : bytes
        The file.
    crs : pyproj.CRS
        CRS of the terrain.

    Returns
    -------
    dict
        ``kind`` and either a ``document`` of shapes, an ``image`` with ``bounds``, or ``places`` with ``heights_m``.

    Raises
    ------
    InputError
        An unknown ending, a damaged file, or one in another projected CRS.
    """
    suffix = Path(name).suffix.lower()
    readers = {suffix: read for group, read in _READERS for suffix in group}
    if suffix not in readers:
        raise InputError(
            f"{name[:80]} ends in {suffix[:20]!r}; an outline ({', '.join(_OUTLINES)}), a raster ({', '.join(_RASTERS)}) or "
            f"points ({', '.join(_POINTS)}) was expected."
        )
    with tempfile.TemporaryDirectory(prefix="firnline-desk-") as folder:
        file = Path(folder) / f"dropped{suffix}"
        file.write_bytes(content)
        try:
            return readers[suffix](file, crs)
        except InputError as error:
            raise InputError(str(error).replace(str(file), Path(name).name[:80])) from error


def _outline(file: Path, crs: CRS) -> dict[str, Any]:
    document = PlanDocument.of_area(SurveyArea.read(file, crs=crs))
    return {
        "kind": "outline",
        "document": document.model_dump(mode="json", include={"areas", "no_go", "starts"}),
    }


def _raster(file: Path, crs: CRS) -> dict[str, Any]:
    from sim.cli.rasters import own_crs
    from survey.core.crs.agreement import same_crs

    stated = own_crs(file)
    if stated is not None:
        same_crs(crs, stated, "the terrain and the raster")
    raster = Dem.read(file, crs=crs if stated is None else None)
    step = max(1, -(-max(raster.shape) // _MOST_PIXELS))
    values = raster.elevation[::step, ::step]
    low, high = (float(limit) for limit in np.nanpercentile(values, [1.0, 99.0]))
    png = base64.b64encode(png_bytes(_pixels(values, low, high))).decode("ascii")
    rows, columns = values.shape
    t, cell = raster.transform, step * raster.step_m
    return {
        "kind": "raster",
        "bounds": [t.c, t.f - rows * cell, t.c + columns * cell, t.f],
        "image": f"data:image/png;base64,{png}",
        "limits": [low, high],
        "colours": legend_colours(ELEVATION),
    }


def _points(file: Path, crs: CRS) -> dict[str, Any]:
    points = SurfacePoints.read(file, crs=crs)
    step = max(1, -(-len(points.xyz) // _MOST_POINTS))
    xyz = points.xyz[::step].round(3)
    return {
        "kind": "points",
        "n_points": len(points.xyz),
        "places": xyz[:, :2].tolist(),
        "heights_m": xyz[:, 2].tolist(),
    }


def _pixels(values: FloatArray, low: float, high: float) -> Any:
    known = np.isfinite(values)
    share = np.where(known, (values - low) / max(high - low, 1e-9), 0.0)
    pixels = np.zeros((*values.shape, 4), dtype=np.uint8)
    pixels[..., :3] = colour_of(ELEVATION, share)
    pixels[..., 3] = np.where(known, 255, 0)
    return pixels


_READERS = ((_OUTLINES, _outline), (_RASTERS, _raster), (_POINTS, _points))
