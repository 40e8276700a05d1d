"""Background of the map that its user knows: a local picture of the ground, warped to tiles on demand, or a map service.

A picture is read on this machine. The tiles of a map service are asked for by the page, and only where the user names its
address; `MapService.host` is the one host that the page may then ask for images.
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import parse_qs, urlsplit

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from desk.terrain.shading import encode_png
from survey.core import Bounds, FloatArray, InputError, refusing_damage, write_bytes
from survey.core.files import existing_file
from survey.io.file_kinds import OFFLINE
from survey.io.raster.opening import open_dataset

_TILE_CELLS = 256
_MOST_TILES = 512
_SUFFIXES = (".tif", ".tiff", ".mbtiles")
_WHAT = "the background"


def is_picture(path: Path) -> bool:
    """Return whether a raster holds colours: red, green and blue, a palette, or three bands of whole numbers."""
    with _opened(path) as source:
        colours = {band.name for band in source.colorinterp}
        whole = np.issubdtype(np.dtype(source.dtypes[0]), np.integer)
        return bool(colours & {"red", "palette"}) or (source.count >= 3 and whole)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a picture by the driver of its suffix; no address that a file names is read."""
    import rasterio

    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(
            f"{path.name[:80]} is no picture that is known by its suffix; {', '.join(_SUFFIXES)} was expected, convert it (gdal_translate)."
        )
    if suffix != ".mbtiles":
        with open_dataset(existing_file(path, _WHAT), 1) as source:
            yield source
        return
    with (
        refusing_damage(f"{_WHAT} {path}", "MBTiles file"),
        rasterio.Env(**OFFLINE),
        rasterio.open(str(existing_file(path, _WHAT).absolute()), driver="MBTiles") as source,
    ):
        yield source


class GroundPicture:
    """Picture of the ground in any CRS.

    `path`: GeoTIFF or MBTiles of colours or grey values. `crs`, `bounds`: projected CRS of the map, and the terrain's bounds
    in it [m]. Numbers beyond bytes are stretched between their 2nd and 98th percentiles. `about`: title, address of a tile
    with the places ``{z}``, ``{x}``, ``{y}`` or ``{bbox}``, and the tile grid, as the page takes them.
    """

    host = ""

    def __init__(self, path: Path, crs: CRS, bounds: Bounds) -> None:
        self._path, self._crs = path, crs
        self._extent = widened(bounds)
        with _opened(path) as source:
            self._bands = [1, 2, 3] if source.count >= 3 else [1]
            self._resolutions_m = halved(self._extent, self._finest_m(source, bounds))
            self._limits = self._stretch(source)
        self._png = lru_cache(_MOST_TILES)(self._drawn)
        self.about = {
            "title": path.name,
            "kind": "tiles",
            "address": f"/tiles/background/{{z}}/{{x}}/{{y}}.png?of={path.stat().st_mtime_ns}",
            "grid": _grid(self._extent, self._resolutions_m),
        }

    def png(self, zoom: int, column: int, row: int) -> bytes | None:
        """Return a tile as PNG, transparent beyond the picture; None where the grid has no such tile."""
        if zoom >= len(self._resolutions_m):
            return None
        side_m = _TILE_CELLS * self._resolutions_m[zoom]
        west, south, east, north = self._extent
        inside = column * side_m < east - west and row * side_m < north - south
        return self._png(zoom, column, row) if inside else None

    def _finest_m(self, source: Any, bounds: Bounds) -> float:
        """Return the width of the picture's cells amid the terrain [m]."""
        if source.crs is None:
            raise InputError(
                f"{self._path} carries no coordinate reference system; write it with one (gdal_edit.py -a_srs)."
            )
        to_source = _transformer(self._crs, CRS.from_wkt(source.crs.to_wkt()))
        if not _overlap(to_source.transform_bounds(*bounds), source.bounds):
            raise InputError(
                f"{self._path} lies elsewhere: none of it is over the terrain; name a picture of the same ground."
            )
        east, north = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
        step_m = 1e-3 * (bounds[2] - bounds[0])
        x, y = to_source.transform([east, east + step_m], [north, north])
        columns, rows = zip(*(~source.transform @ place for place in zip(x, y, strict=True)), strict=True)
        return step_m / max(math.hypot(columns[1] - columns[0], rows[1] - rows[0]), 1e-9)

    def _stretch(self, source: Any) -> FloatArray | None:
        """Return the numbers (bands, 2) that are drawn black and white; None for bytes."""
        if source.dtypes[0] == "uint8":
            return None
        sides = (min(512, source.height), min(512, source.width))
        few = source.read(self._bands, out_shape=(len(self._bands), *sides), masked=True)
        known = few.astype(np.float64).filled(np.nan).reshape(len(self._bands), -1)
        if not np.isfinite(known).any(axis=1).all():
            raise InputError(f"{self._path} has a band without any value; name another picture.")
        limits: FloatArray = np.nanpercentile(known, [2.0, 98.0], axis=1).T
        return limits

    def _drawn(self, zoom: int, column: int, row: int) -> bytes:
        """Warp a tile; GDAL reads the overview that suits it, in the thread that has opened the file."""
        from rasterio.enums import ColorInterp, Resampling
        from rasterio.vrt import WarpedVRT

        cell_m = self._resolutions_m[zoom]
        west = self._extent[0] + column * _TILE_CELLS * cell_m
        north = self._extent[3] - row * _TILE_CELLS * cell_m
        with _opened(self._path) as source:
            has_palette = source.colorinterp[0] == ColorInterp.palette
            options = {
                "crs": self._crs.to_wkt(),
                "transform": Affine(cell_m, 0.0, west, 0.0, -cell_m, north),
                "width": _TILE_CELLS,
                "height": _TILE_CELLS,
                "resampling": Resampling.nearest if has_palette else Resampling.bilinear,
                "add_alpha": ColorInterp.alpha not in source.colorinterp,
            }
            with WarpedVRT(source, **options) as warped:
                values, alpha = warped.read(self._bands), warped.dataset_mask()
            palette = source.colormap(1) if has_palette else None
        return encode_png(np.dstack([self._colours(values, palette), alpha]).astype(np.uint8))

    def _colours(
        self, values: npt.NDArray[Any], palette: dict[int, tuple[int, ...]] | None
    ) -> npt.NDArray[Any]:
        """Return red, green and blue (h, w, 3) of the numbers (bands, h, w) of a picture."""
        if palette is not None:
            table = np.array([palette.get(k, (0, 0, 0))[:3] for k in range(256)])
            return np.asarray(table[values[0]])
        if self._limits is not None:
            low, high = self._limits[:, :1, None], self._limits[:, 1:, None]
            values = np.clip((values - low) / np.maximum(high - low, 1e-9), 0.0, 1.0) * 255.0
        return np.broadcast_to(np.moveaxis(values, 0, -1), (*values.shape[1:], 3))


class MapService(NamedTuple):
    """Tiles of an address that the user named; the page asks for them, this machine's server does not.

    `host`: origin that the page asks for images. `about`: as for `GroundPicture`.
    """

    host: str
    about: dict[str, Any]

    @classmethod
    def of(cls, address: str, crs: CRS, bounds: Bounds) -> "MapService":
        """Return the service at ``https://HOST/{z}/{x}/{y}.png`` in Web Mercator, or a WMS with its ``layers=`` in the CRS of the map."""
        parts = urlsplit(address)
        host = f"{parts.scheme}://{parts.netloc}"
        if not re.fullmatch(r"https?://[A-Za-z0-9.-]+(:\d{1,5})?", host):
            raise InputError(
                f"the background {address[:120]!r} names no plain host; https://HOST/… was expected, without user, password or {{s}}."
            )
        if all(place in address for place in ("{z}", "{x}", "{y}")):
            about = {"kind": "xyz", "address": address, **_mercator(crs, widened(bounds))}
        elif "layers" in {name.lower() for name in parse_qs(parts.query)}:
            about = _wms(address, crs, widened(bounds))
        else:
            raise InputError(
                f"the background {address[:120]!r} has neither {{z}}, {{x}} and {{y}} nor layers=; name https://HOST/{{z}}/{{x}}/{{y}}.png, or a "
                "WMS as in https://HOST/wms?layers=NAME."
            )
        return cls(host, {"title": parts.netloc, **about})

    def png(self, zoom: int, column: int, row: int) -> None:
        """Return nothing: the page asks the service itself."""


def _wms(address: str, crs: CRS, extent: Bounds) -> dict[str, Any]:
    code = ":".join(crs.to_authority() or ())
    if not code:
        raise InputError(
            "the CRS of the terrain has no code that a WMS could be asked for; name a local picture."
        )
    asked = (
        "&SERVICE=WMS&VERSION=1.1.1&REQUEST=GetMap&STYLES=&FORMAT=image/png&TRANSPARENT=TRUE&WIDTH=256&HEIGHT=256"
        f"&SRS={code}&BBOX={{bbox}}"
    )
    return {"kind": "wms", "address": address + asked, "grid": _grid(extent, halved(extent, 0.05))}


_DEGREE = 6
_FIT_ALONG = 15


def _mercator(crs: CRS, extent: Bounds) -> dict[str, Any]:
    """Return polynomials from the coordinates of the map to Web Mercator and back, for the page, which knows no projections.

    Their coefficients are fitted over the extent; over 100 km they err by less than a millimetre.
    """
    x, y = (
        axis.ravel()
        for axis in np.meshgrid(*(np.linspace(extent[k], extent[k + 2], _FIT_ALONG) for k in (0, 1)))
    )
    east, north = _transformer(crs, CRS("EPSG:3857")).transform(x, y)
    if not np.isfinite([east, north]).all() or np.abs(north).max() > 2.0e7:
        raise InputError(
            "the terrain reaches beyond 85 degrees of latitude, where XYZ tiles end; name a WMS or a local picture."
        )
    here, there = np.column_stack([x, y]), np.column_stack([east, north])
    return {"to_mercator": _polynomial(here, there), "from_mercator": _polynomial(there, here)}


def _polynomial(places: FloatArray, values: FloatArray) -> dict[str, Any]:
    """Fit both values (N, 2) by polynomials of places (N, 2); terms are in the order of `_powers`."""
    centre, scale = places.mean(axis=0), float(np.ptp(places, axis=0).max()) / 2.0
    u, v = ((places - centre) / scale).T
    terms = np.column_stack([u**i * v**j for i, j in _powers()])
    offset = values.mean(axis=0)
    factors = np.linalg.lstsq(terms, values - offset, rcond=None)[0]
    return {
        "centre": centre.tolist(), "scale": scale, "offset": offset.tolist(), "powers": _powers(),
        "factors": factors.T.tolist(),
    }  # fmt: skip


def _powers() -> list[tuple[int, int]]:
    return [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]


def widened(bounds: Bounds) -> Bounds:
    """Return the bounds that the map can be moved over: half of the longer side more on each side."""
    margin = 0.5 * max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    return bounds[0] - margin, bounds[1] - margin, bounds[2] + margin, bounds[3] + margin


def halved(extent: Bounds, finest_m: float) -> list[float]:
    """Return widths of cells [m] from the one with the extent in a tile down to the finest, each half of the one before."""
    side_m = max(extent[2] - extent[0], extent[3] - extent[1])
    n_levels = max(1, math.ceil(math.log2(max(side_m / (_TILE_CELLS * finest_m), 1.0))) + 1)
    return [side_m / _TILE_CELLS / 2**k for k in range(min(n_levels, 30))]


def _grid(extent: Bounds, resolutions_m: list[float]) -> dict[str, Any]:
    return {"extent": extent, "tile_cells": _TILE_CELLS, "resolutions_m": resolutions_m}


def _transformer(crs: CRS, target: CRS) -> Transformer:
    try:
        return Transformer.from_crs(crs, target, always_xy=True)
    except ProjError as error:
        raise InputError(
            f"the background is in {target.name} and the terrain in {crs.name}, and no transformation between them is known."
        ) from error


def _overlap(a: Bounds, b: Bounds) -> bool:
    limits = np.array([a, b])
    return bool(np.isfinite(limits).all() and (limits[:, :2].max(axis=0) < limits[:, 2:].min(axis=0)).all())


def open_background(named: str, crs: CRS, bounds: Bounds) -> GroundPicture | MapService:
    """Open a local picture, or take the address of a map service."""
    if re.match(r"[a-z]+://", named):
        return MapService.of(named, crs, bounds)
    return GroundPicture(Path(named), crs, bounds)


def stored_picture(stem: Path) -> Path | None:
    """Return the picture that was dropped onto the map of a plan before; None without one."""
    files = (stem.with_name(f"{stem.name}_background{suffix}") for suffix in _SUFFIXES)
    return next((file for file in files if file.exists()), None)


def store_picture(stem: Path, name: str, content: bytes, crs: CRS, bounds: Bounds) -> GroundPicture:
    """Store a dropped picture beside the plan in place of the one before, once it can be drawn."""
    suffix = Path(name).suffix.lower()
    draft = stem.with_name(f"{stem.name}_background-new{suffix if suffix in _SUFFIXES else '.tif'}")
    try:
        write_bytes(draft, content)
        GroundPicture(draft, crs, bounds)
        before = stored_picture(stem)
        if before is not None:
            before.unlink()
        return GroundPicture(draft.replace(draft.with_stem(f"{stem.name}_background")), crs, bounds)
    except InputError as error:
        raise InputError(str(error).replace(str(draft), Path(name).name[:80])) from error
    finally:
        draft.unlink(missing_ok=True)
