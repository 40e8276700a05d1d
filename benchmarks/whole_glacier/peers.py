"""Programs that a user would take instead: gdal_grid, and verde where ``FIRNLINE_VERDE`` names a Python that has it."""

import os
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
import rasterio

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import MadeSurvey
from benchmarks.whole_glacier.mapping import Used, command, control_file, judged, used_by
from survey.core.arrays import FloatArray

_SEED = 103
_BASELINE = "gdal_grid, triangles"
_ALGORITHMS = {
    "gdal_grid, inverse distances": "invdist:power=2:radius1=3:radius2=3:max_points=12:nodata=-9999",
    _BASELINE: "linear:nodata=-9999",
}
_VERDE = ("block means and triangles", "ten nearest points")
_VERDE_PYTHON = os.environ.get("FIRNLINE_VERDE")


class PeerErrors(NamedTuple):
    """Root mean square error [m], and the same without the mean error, which control points would take away."""

    rmse_m: float
    level_free_m: float


class PeerGrid(NamedTuple):
    """Cells of 1 m: western and northern edge [m], number of columns and rows."""

    west: float
    north: float
    columns: int
    rows: int

    @classmethod
    def over(cls, xyz: FloatArray) -> "PeerGrid":
        """Return the cells over points (N, 3) [m]."""
        west, south = np.floor(xyz[:, :2].min(axis=0))
        east, north = np.ceil(xyz[:, :2].max(axis=0))
        return cls(float(west), float(north), int(east - west), int(north - south))

    def errors(self, made: MadeSurvey, height: FloatArray) -> PeerErrors:
        """Return the errors of heights (rows, columns) [m], where there are any."""
        row, column = np.indices(height.shape) + 0.5
        truth = made.heights((self.west + column).ravel(), (self.north - row).ravel())
        error = height - truth.reshape(height.shape)
        return PeerErrors(float(np.sqrt(np.nanmean(error**2))), float(np.nanstd(error)))


Gridding = Callable[[], tuple[FloatArray, Used]]
"""Returns the heights (rows, columns) [m] that a program makes of the points, and what it used."""


def beside_others(folder: Path, density: float) -> Iterator[Row]:
    """Yield error and CPU time beside those of the programs that are installed."""
    made = MadeSurvey(_SEED, 500.0, 500.0, density)
    files = made.write(folder / "peers")
    control = str(control_file(made, folder))
    used = used_by(command(files, folder / "own", "--workers", "1", "--control", control))
    own = judged(made, folder / "own" / "dem.vrt")
    own_errors = PeerErrors(own.rmse_m, float(np.sqrt(own.rmse_m**2 - own.mean_m**2)))
    xyz = np.concatenate([np.column_stack([p.x, p.y, p.z]) for p in map(laspy.read, files)])
    grid = PeerGrid.over(xyz)
    for name, gridding in (_gdal(folder, xyz, grid) | _verde(folder, xyz, grid)).items():
        height, peer_used = gridding()
        yield from _error_rows(name, own_errors, grid.errors(made, height))
        what, ratio = f"CPU time over that of {name}", used.cpu_s / peer_used.cpu_s
        yield Row.of(what, ratio, "", "<=", 2.0) if name == _BASELINE else Row(what, ratio, "")


def _error_rows(name: str, own: PeerErrors, peer: PeerErrors) -> Iterator[Row]:
    """Yield the errors of a program, and our errors over them."""
    yield Row(f"{name}: RMSE", peer.rmse_m, "m")
    yield Row.of(f"RMSE over that of {name}", own.rmse_m / peer.rmse_m, "", "<=", 0.9)
    yield Row(f"{name}: RMSE without mean error", peer.level_free_m, "m")
    ratio = own.level_free_m / peer.level_free_m
    yield Row.of(f"RMSE without mean errors over that of {name}", ratio, "", "<=", 0.9)


def _gdal(folder: Path, xyz: FloatArray, grid: PeerGrid) -> dict[str, Gridding]:
    """Return the algorithms of gdal_grid; none where it is not installed."""
    if shutil.which("gdal_grid") is None:
        return {}
    np.savetxt(folder / "points.csv", xyz, fmt="%.3f", delimiter=",", header="x,y,z", comments="")
    (folder / "points.vrt").write_text(
        '<OGRVRTDataSource><OGRVRTLayer name="points"><SrcDataSource relativeToVRT="1">points.csv</SrcDataSource>'
        '<GeometryType>wkbPoint25D</GeometryType><GeometryField encoding="PointFromColumns" x="x" y="y" z="z"/>'
        "</OGRVRTLayer></OGRVRTDataSource>",
        encoding="utf-8",
    )
    return {name: partial(_by_gdal_grid, folder, grid, algorithm) for name, algorithm in _ALGORITHMS.items()}


def _by_gdal_grid(folder: Path, grid: PeerGrid, algorithm: str) -> tuple[FloatArray, Used]:
    west, north, columns, rows = grid
    extent = [*("-txe", f"{west}", f"{west + columns}"), *("-tye", f"{north}", f"{north - rows}")]
    size, out = ["-outsize", f"{columns}", f"{rows}"], folder / "peer.tif"
    used = used_by(
        ["gdal_grid", "-q", "-a", algorithm, *extent, *size, "-ot", "Float64", "-l", "points"]
        + [str(folder / "points.vrt"), str(out)]
    )
    with rasterio.open(out) as source:
        return source.read(1, masked=True).filled(np.nan), used


def _verde(folder: Path, xyz: FloatArray, grid: PeerGrid) -> dict[str, Gridding]:
    """Return the methods of verde; none where no Python that has it is named."""
    if _VERDE_PYTHON is None:
        return {}
    np.save(folder / "points.npy", xyz)
    return {f"verde, {method}": partial(_by_verde, folder, grid, method) for method in _VERDE}


def _by_verde(folder: Path, grid: PeerGrid, method: str) -> tuple[FloatArray, Used]:
    script, out = Path(__file__).with_name("verde_grid.py"), folder / "verde.npy"
    used = used_by(
        [str(_VERDE_PYTHON), str(script), str(folder / "points.npy"), *map(str, grid), method, str(out)]
    )
    heights: FloatArray = np.load(out)
    return heights, used
