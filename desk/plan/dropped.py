"""Files that are dropped onto the page: outlines, rasters, points."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from desk.plan.document import PlanDocument
from desk.terrain.shading import ELEVATION
from desk.terrain.tiles import picture
from survey import Dem, InputError, SurfacePoints, SurveyArea
from survey.core.arrays import FloatArray
from survey.data.outlines import read_outlines_file
from survey.io.vector import geometry_types

_OUTLINES = (".geojson", ".json", ".gpkg", ".kml", ".kmz", ".fgb")
_PICTURES = (".tif", ".tiff", ".mbtiles")
_RASTERS = (*_PICTURES, ".asc", ".hgt", ".nc")
_POINTS = (".csv", ".las", ".laz", ".ply")
_MOST_POINTS = 5000
SIGMA_M = 0.05
"""Standard deviation of heights that state none [m]."""


def dropped(name: str, content: bytes, crs: CRS, select: Sequence[str] = ()) -> dict[str, Any]:
    """Return what a dropped file holds, in the CRS of the terrain.

    `select`: which glaciers of an inventory (`SurveyArea.read`), or ``elevations`` for a raster that could be either. Returns:
    ``kind`` and either a ``document`` of shapes, the ``choices`` of an inventory, an ``image`` with ``bounds``, or ``places``
    with ``heights_m``; the kind alone for a ``picture`` and for a raster of ``either`` elevations or grey values.
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
            return readers[suffix](file, crs, select)
        except InputError as error:
            raise InputError(str(error).replace(str(file), Path(name).name[:80])) from error


def _shapes(file: Path, crs: CRS, select: Sequence[str]) -> dict[str, Any]:
    """Return the outline in a vector file, or its points where it has no other geometry, as landmarks have."""
    if geometry_types(file, what="the file") == {"Point"}:
        return _points(file, crs, ())
    outlines = read_outlines_file(file, "the file")
    if not select and (outlines.of_inventory or outlines.is_area.sum() > 1):
        known = zip(outlines.titles, outlines.keys, outlines.is_area, strict=True)
        choices = [("all of them", "*"), *sorted((title, key) for title, key, is_area in known if is_area)]
        return {"kind": "choices", "choices": [{"title": title, "select": key} for title, key in choices]}
    document = PlanDocument.of_area(SurveyArea.read(file, crs=crs, select=select))
    return {
        "kind": "outline",
        "document": document.model_dump(mode="json", include={"areas", "no_go", "starts"}),
    }


def _raster(file: Path, crs: CRS, select: Sequence[str]) -> dict[str, Any]:
    from desk.terrain.background import is_picture
    from firnline.actions.interface import own_crs
    from survey.core.crs import same_crs

    if not select and file.suffix in _PICTURES:
        return {"kind": "picture" if is_picture(file) else "either"}
    stated = own_crs(file)
    if stated is not None:
        same_crs(crs, stated, "the terrain and the raster")
    raster = Dem.read(file, crs=crs if stated is None else None)
    low, high = (float(limit) for limit in np.nanpercentile(raster.elevation, [1.0, 99.0]))
    return {"kind": "raster", **picture(raster, ELEVATION, low, high)}


def _points(file: Path, crs: CRS, _: Sequence[str]) -> dict[str, Any]:
    points = SurfacePoints.read(file, crs=crs, sigma_m=SIGMA_M)
    return {"kind": "points", **thinned_points(points.xyz)}


def thinned_points(xyz: FloatArray) -> dict[str, Any]:
    """Return the number of points, and some of them for the map.

    `xyz` (N, 3): easting, northing and height [m]. Returns: ``n_points``, ``places`` and ``heights_m``.
    """
    some = xyz[:: max(1, -(-len(xyz) // _MOST_POINTS))].round(3)
    return {"n_points": len(xyz), "places": some[:, :2].tolist(), "heights_m": some[:, 2].tolist()}


_READERS = ((_OUTLINES, _shapes), (_RASTERS, _raster), (_POINTS, _points))
