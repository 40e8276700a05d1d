"""Programs that a user would take instead: gdal_grid by inverse distances and by triangles."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
import rasterio

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import MadeSurvey
from benchmarks.whole_glacier.mapping import Used, command, control_file, judged, used_by

_SEED = 103

_ALGORITHMS = {
    "inverse distances": "invdist:power=2:radius1=3:radius2=3:max_points=12:nodata=-9999",
    "triangles": "linear:nodata=-9999",
}


class PeerError(RuntimeError):
    """gdal_grid is not installed."""


def beside_gdal(folder: Path, density: float) -> Iterator[Row]:
    """Yield error and CPU time beside gdal_grid's."""
    made = MadeSurvey(_SEED, 500.0, 500.0, density)
    files = made.write(folder / "peers")
    control = str(control_file(made, folder))
    used = used_by(command(files, folder / "own", "--workers", "1", "--control", control))
    own = judged(made, folder / "own" / "dem.vrt")
    try:
        found = gdal_grid(made, files, folder)
    except PeerError:
        return
    for name, (rmse_m, peer_used) in found.items():
        yield Row(f"gdal_grid, {name}: RMSE", rmse_m, "m")
        yield Row.of(f"RMSE over that of gdal_grid, {name}", own.rmse_m / rmse_m, "", "<=", 0.9)
        ratio = used.cpu_s / peer_used.cpu_s
        if name == "triangles":
            yield Row.of(f"CPU time over that of gdal_grid, {name}", ratio, "", "<=", 2.0)
        else:
            yield Row(f"CPU time over that of gdal_grid, {name}", ratio, "")


def gdal_grid(made: MadeSurvey, files: list[Path], folder: Path) -> dict[str, tuple[float, Used]]:
    """Return RMSE [m] over the inner cells and what was used, for each algorithm.

    Raises
    ------
    PeerError
        gdal_grid is not installed.
    """
    if shutil.which("gdal_grid") is None:
        raise PeerError("gdal_grid is not installed; install GDAL's programs.")
    parts = [laspy.read(file) for file in files]
    xyz = np.concatenate([np.column_stack([p.x, p.y, p.z]) for p in parts])
    np.savetxt(folder / "points.csv", xyz, fmt="%.3f", delimiter=",", header="x,y,z", comments="")
    west, south, east, north = *np.floor(xyz[:, :2].min(axis=0)), *np.ceil(xyz[:, :2].max(axis=0))
    (folder / "points.vrt").write_text(
        '<OGRVRTDataSource><OGRVRTLayer name="points"><SrcDataSource relativeToVRT="1">points.csv</SrcDataSource>'
        '<GeometryType>wkbPoint25D</GeometryType><GeometryField encoding="PointFromColumns" x="x" y="y" z="z"/>'
        "</OGRVRTLayer></OGRVRTDataSource>",
        encoding="utf-8",
    )
    extent = ["-txe", f"{west}", f"{east}", "-tye", f"{north}", f"{south}"]
    size = ["-outsize", f"{int(east - west)}", f"{int(north - south)}"]
    found = {}
    for name, algorithm in _ALGORITHMS.items():
        out = folder / "peer.tif"
        used = used_by(
            ["gdal_grid", "-q", "-a", algorithm, *extent, *size, "-ot", "Float64", "-l", "points"]
            + [str(folder / "points.vrt"), str(out)]
        )
        found[name] = (_rmse(made, out), used)
    return found


def _rmse(made: MadeSurvey, raster: Path) -> float:
    with rasterio.open(raster) as source:
        height, t = source.read(1, masked=True).filled(np.nan), source.transform
    row, column = (n + 0.5 for n in np.indices(height.shape, dtype=np.float64))
    truth = made.heights((t.c + t.a * column).ravel(), (t.f + t.e * row).ravel()).reshape(height.shape)
    return float(np.sqrt(np.nanmean((height - truth) ** 2)))
