"""Bad rasters at every place where a command reads one."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import rasterio
from affine import Affine

from benchmarks.bad_input.case import Case, Prepare, both, text
from benchmarks.bad_input.good import (
    DEM_MISSION,
    PLACE,
    SOUTH,
    UTM,
    WEST,
    area,
    hills,
    points,
    raster,
    write_raster,
)

Write = Callable[[Path], None]


def _with(values: np.ndarray | None = None, **profile: object) -> Write:
    return lambda path: write_raster(path, hills() if values is None else values, **profile)


def _cut(share: float) -> Write:
    def write(path: Path) -> None:
        write_raster(path, hills())
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])

    return write


def _overwritten(path: Path) -> None:
    write_raster(path, hills(), compress="deflate")
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 200] = bytes(200)
    path.write_bytes(bytes(content))


def _sparse(path: Path) -> None:
    profile = {"sparse_ok": True, "compress": "deflate", "tiled": True}
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        count=1,
        dtype="float32",
        height=12_600,
        width=12_600,
        crs=UTM,
        transform=PLACE,
        **profile,
    ):
        pass


def _vrt(source: str) -> Write:
    def write(path: Path) -> None:
        path.write_text(
            '<VRTDataset rasterXSize="50" rasterYSize="50"><VRTRasterBand dataType="Float32" band="1">'
            f'<SimpleSource><SourceFilename relativeToVRT="0">{source}</SourceFilename>'
            "<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
        )

    return write


def _wms(path: Path) -> None:
    path.write_text(
        '<GDAL_WMS><Service name="TMS"><ServerUrl>http://127.0.0.1:9/${z}/${x}/${y}.png</ServerUrl></Service>'
        "<DataWindow><UpperLeftX>0</UpperLeftX><UpperLeftY>0</UpperLeftY><LowerRightX>1</LowerRightX>"
        "<LowerRightY>1</LowerRightY><TileLevel>1</TileLevel></DataWindow><BandsCount>1</BandsCount></GDAL_WMS>"
    )


def _unit(unit: str) -> Write:
    def write(path: Path) -> None:
        write_raster(path, hills())
        with rasterio.open(path, "r+") as target:
            target.units = (unit,)

    return write


def _rgb(path: Path) -> None:
    bands = np.stack([hills(), hills(), hills()])
    write_raster(path, bands, dtype="uint8", nodata=None, photometric="RGB")


def _palette(path: Path) -> None:
    write_raster(path, hills(), dtype="uint8", nodata=None)
    with rasterio.open(path, "r+") as target:
        target.write_colormap(1, {i: (i, i, i, 255) for i in range(256)})


def _complex(path: Path) -> None:
    write_raster(path, hills(), dtype="complex64", nodata=None)


def _folder(path: Path) -> None:
    path.mkdir()


def _dangling(path: Path) -> None:
    path.symlink_to("nowhere.tif")


def _hole(value: float) -> Write:
    values = hills()
    values[20:25, 20:25] = value
    return lambda path: write_raster(path, values)


RASTERS: dict[str, Write] = {
    "missing": lambda _: None,
    "empty": lambda path: path.write_bytes(b"") and None,
    "text": lambda path: path.write_text("this is no raster") and None,
    "random bytes": lambda path: path.write_bytes(np.random.default_rng(1).bytes(5000)) and None,
    "folder": _folder,
    "dangling link": _dangling,
    "cut in the header": _cut(0.02),
    "cut in half": _cut(0.5),
    "block overwritten": _overwritten,
    "no CRS": _with(crs=None),
    "rotated": _with(transform=Affine.rotation(20.0) @ PLACE),
    "south-up": _with(transform=Affine(3.0, 0.0, WEST, 0.0, 3.0, SOUTH)),
    "oblong cells": _with(transform=Affine(3.0, 0.0, WEST, 0.0, -4.0, SOUTH + 150.0)),
    "cells of 0 m": _with(transform=Affine(1e-9, 0.0, WEST, 0.0, -1e-9, SOUTH)),
    "in feet": _with(crs="EPSG:2225"),
    "band unit furlong": _unit("furlong"),
    "all nodata": _with(np.full((50, 50), -9999.0)),
    "all NaN": _with(np.full((50, 50), np.nan), nodata=None),
    "infinite": _with(np.full((50, 50), np.inf), nodata=None),
    "one cell": _with(np.ones((1, 1))),
    "one row": _with(np.ones((1, 50))),
    "heights of 1e30 m": _with(1e30 * hills(), dtype="float64", nodata=None),
    "RGB image": _rgb,
    "palette": _palette,
    "complex": _complex,
    "sparse of 158,000,000 cells": _sparse,
    "VRT in a .tif": _vrt("good.tif"),
    "VRT over http in a .tif": _vrt("/vsicurl/http://127.0.0.1:9/a.tif"),
    "WMS in a .tif": _wms,
    "elsewhere": _with(transform=Affine(3.0, 0.0, WEST + 90_000.0, 0.0, -3.0, SOUTH)),
    "another zone": _with(crs="EPSG:32609"),
}
# Only some places need heights in every cell, or a common ground.
PARTLY = {"hole of nodata": _hole(-9999.0), "hole of NaN": _hole(np.nan)}


def _reading(write: Write, name: str) -> Prepare:
    return lambda folder: write(folder / name)


def _uses(name: str) -> dict[str, tuple[Prepare, list[str]]]:
    """Return every place that reads a raster of this name: what stands beside it, and the command."""
    quiet = ["-q"]
    mission = text("m.toml", DEM_MISSION)
    return {
        "run": (mission, ["run", "m.toml", "--runs", "runs", "--until", "plan", *quiet]),
        "plan --prior": (area, ["plan", "area.gpkg", "--prior", name, *quiet]),
        "plan --no-go": (area, ["plan", "area.gpkg", "--no-go", name, *quiet]),
        "reconstruct --prior": (
            points,
            ["reconstruct", "points.csv", "--crs", UTM, "--grid", "10", "--prior", name, *quiet],
        ),
        "score map": (raster("good.tif"), ["score", name, "--truth", "good.tif", *quiet]),
        "score --truth": (raster("good.tif"), ["score", "good.tif", "--truth", name, *quiet]),
        "change later": (
            both(raster("good.tif"), area),
            ["change", name, "good.tif", "--outline", "area.gpkg"],
        ),
        "change earlier": (
            both(raster("good.tif"), area),
            ["change", "good.tif", name, "--outline", "area.gpkg"],
        ),
        "export": (raster("good.tif"), ["export", name, "out.asc"]),
        "init --dem": (raster("good.tif"), ["init", "new.toml", "--dem", name]),
    }


# A place on its own is no fault of a raster that is only converted, copied or described.
_FINE_ALONE = {"elsewhere", "another zone"}
_ALONE = {"export", "init --dem", "run"}
_FINE_TO_EXPORT = {"all nodata", "all NaN", "infinite", "one cell", "one row"}
_FINE = {"south-up", "sparse of 158,000,000 cells"}


def _rows_turned(folder: Path, _: str) -> str:
    """Return what is wrong with the grid of a raster whose first row is the southern one."""
    lines = (folder / "out.asc").read_text().splitlines()
    rows = [line.split() for line in lines if not line[:1].isalpha()]
    found = np.array(rows, dtype=np.float64)
    return (
        ""
        if np.allclose(found, hills()[::-1], atol=1e-3)
        else "the rows are not those of the raster, from the north on"
    )


def raster_cases() -> list[Case]:
    """Return every bad raster at every place."""
    cases = []
    for wrong, write in RASTERS.items():
        for place, (beside, args) in _uses("dem.tif").items():
            fine = (wrong in _FINE_ALONE and place in _ALONE) or wrong in _FINE
            fine = fine or (wrong in _FINE_TO_EXPORT and place == "export")
            right = _rows_turned if (wrong, place) == ("south-up", "export") else None
            prepare = both(beside, _reading(write, "dem.tif"))
            cases.append(Case(f"raster {wrong} · {place}", prepare, args, fine, right))
    for wrong, write in PARTLY.items():
        beside, args = _uses("dem.tif")["run"]
        cases.append(Case(f"raster {wrong} · run", both(beside, _reading(write, "dem.tif")), args))
    return cases
