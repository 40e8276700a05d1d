"""STAC item of a raster: what catalogues of geodata need to find a map (SpatioTemporal Asset Catalog 1.1.0).

`write_stac_item` writes one feature of GeoJSON with footprint, days, projection, and the raster as its asset: bands with names, units and statistics, size
and checksum. Extensions are projection and file.
"""

import hashlib
import json
import os
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from rasterio.windows import Window

from survey.core import FloatArray, InputError, existing_file, write_text
from survey.core.crs import vertical_datum_of
from survey.io.raster import band_names, raster_header
from survey.io.raster.opening import open_dataset
from survey.io.raster.reading import stated_datum

_VERSION = "1.1.0"
_EXTENSIONS = tuple(
    f"https://stac-extensions.github.io/{name}/schema.json" for name in ("projection/v2.0.0", "file/v2.1.0")
)
_MEDIA = {
    ".tif": "image/tiff; application=geotiff",
    ".tiff": "image/tiff; application=geotiff",
    ".nc": "application/netcdf",
    ".asc": "text/plain",
}
_COG = "; profile=cloud-optimized"
_SHA256 = "1220"  # of a multihash: function and length in bytes
_N_EDGE = 21  # points along a side of the footprint
_STRIP_CELLS = 4_000_000
_BLOCK_BYTES = 2**20


def write_stac_item(source: str | Path, out: str | Path, first: date, last: date | None = None) -> None:
    """Write the STAC item of a raster, whose path is relative to that of the item.

    Parameters
    ----------
    source : str or pathlib.Path
        GeoTIFF, NetCDF or ASCII grid with a CRS.
    out : str or pathlib.Path
        The item, ``.json``.
    first, last : datetime.date
        First and last day of the survey; one day where the last is left out.

    Raises
    ------
    InputError
        The raster has no CRS, or the last day is before the first.
    """
    if last is not None and last < first:
        raise InputError(
            f"the last day of the survey, {last}, is before the first, {first}; exchange them (--days)."
        )
    item = _item(existing_file(source, "the raster"), Path(out), first, last or first)
    write_text(out, json.dumps(item, indent=2, ensure_ascii=False) + "\n")


def _item(source: Path, out: Path, first: date, last: date) -> dict[str, Any]:
    header = raster_header(source)
    if header.crs is None:
        raise InputError(
            f"{source} has no CRS, and the place of a STAC item is in degrees; export it with --crs as .tif first."
        )
    crs = CRS.from_user_input(header.crs)
    rows, columns = header.shape
    t = header.transform
    corners = np.array([t @ corner for corner in ((0, 0), (0, rows), (columns, rows), (columns, 0))])
    outline = _in_degrees(corners, crs)
    code = crs.to_authority()
    projection: dict[str, Any] = {"proj:code": None if code is None else ":".join(code)}
    if code is None:
        projection["proj:wkt2"] = crs.to_wkt()
    return {
        "type": "Feature",
        "stac_version": _VERSION,
        "stac_extensions": list(_EXTENSIONS),
        "id": out.name.removesuffix(".json"),
        "geometry": {"type": "Polygon", "coordinates": [outline.round(7).tolist()]},
        "bbox": [*outline.min(axis=0).round(7).tolist(), *outline.max(axis=0).round(7).tolist()],
        "properties": {
            **_days(first, last),
            **projection,
            "proj:shape": [rows, columns],
            "proj:transform": [t.a, t.b, t.c, t.d, t.e, t.f],
            "proj:bbox": [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()],
        },
        "links": [],
        "assets": {"map": _asset(source, out, header.crs)},
    }


def _days(first: date, last: date) -> dict[str, str | None]:
    """Return the time of the item: that of noon on one day, or the beginning of the first and the end of the last."""
    if first == last:
        return {"datetime": f"{first}T12:00:00Z"}
    return {"datetime": None, "start_datetime": f"{first}T00:00:00Z", "end_datetime": f"{last}T23:59:59Z"}


def _in_degrees(corners: FloatArray, crs: CRS) -> FloatArray:
    """Return the closed outline (N, 2), counter-clockwise, as longitude and latitude [deg]."""
    share = np.linspace(0.0, 1.0, _N_EDGE)[:-1, None]
    sides = [
        (1.0 - share) * corner + share * after
        for corner, after in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    places = np.concatenate([*sides, corners[:1]])
    to_degrees = Transformer.from_crs(crs, "OGC:CRS84", always_xy=True)
    return np.column_stack(to_degrees.transform(places[:, 0], places[:, 1]))


def _asset(source: Path, out: Path, crs: str) -> dict[str, Any]:
    """Return the raster as an asset, with its bands, its size and its checksum."""
    suffix = source.suffix.lower()
    with open_dataset(source, 1) as opened:
        is_cog = opened.tags(ns="IMAGE_STRUCTURE").get("LAYOUT") == "COG"
        datum = stated_datum(opened) or vertical_datum_of(crs)
        bands = [
            {
                "name": name,
                **({"unit": opened.units[k]} if opened.units[k] else {}),
                "data_type": opened.dtypes[k],
                **({} if opened.nodata is None else {"nodata": _number(float(opened.nodata))}),
                "statistics": _statistics(opened, k + 1),
            }
            for k, name in enumerate(band_names(source)[: opened.count])
        ]
    made = datetime.fromtimestamp(source.stat().st_mtime, UTC)
    return {
        "href": Path(os.path.relpath(source.absolute(), out.absolute().parent)).as_posix(),
        "type": _MEDIA.get(suffix, "application/octet-stream") + (_COG if is_cog else ""),
        "roles": ["data"],
        **({"description": f"heights above {datum}"} if datum else {}),
        "updated": f"{made:%Y-%m-%dT%H:%M:%SZ}",
        "file:size": source.stat().st_size,
        "file:checksum": _SHA256 + _sha256(source),
        "bands": bands,
    }


def _number(value: float) -> float | str:
    """Return a number as JSON has it; what is not finite is a word there."""
    return value if np.isfinite(value) else str(value)


def _statistics(opened: Any, band: int) -> dict[str, float]:
    """Return least and largest value, mean, standard deviation and the share of known cells [%], read in strips."""
    n, total, squares, low, high = 0, 0.0, 0.0, np.inf, -np.inf
    height = max(1, _STRIP_CELLS // opened.width)
    for top in range(0, opened.height, height):
        window = Window(0, top, opened.width, min(height, opened.height - top))
        values = opened.read(band, window=window, masked=True).compressed().astype(np.float64)
        values = values[np.isfinite(values)]
        if len(values):
            n, total, squares = n + len(values), total + values.sum(), squares + (values**2).sum()
            low, high = min(low, values.min()), max(high, values.max())
    share = {"valid_percent": round(100.0 * n / (opened.width * opened.height), 3)}
    if n == 0:
        return share
    mean = total / n
    spread = np.sqrt(max(squares / n - mean**2, 0.0))
    return {
        "minimum": float(low),
        "maximum": float(high),
        "mean": float(mean),
        "stddev": float(spread),
        **share,
    }


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while part := stream.read(_BLOCK_BYTES):
            digest.update(part)
    return digest.hexdigest()
