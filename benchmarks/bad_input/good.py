"""Good input on one site of 150 m, beside which one file of a case is bad."""

from pathlib import Path

import numpy as np
import rasterio
import shapely
from affine import Affine
from pyproj import CRS

from benchmarks.bad_input.case import Prepare, both, text
from survey.data.area import SurveyArea
from survey.io.vector import write_features

UTM = "EPSG:32608"
WEST, SOUTH, SIDE_M, STEP_M = 500_000.0, 6_700_000.0, 150.0, 3.0
MISSION = """
schema_version = 1
name = "m"
[terrain]
source = "random"
size_m = 150.0
step_m = 3.0
[satellite]
cell_m = 75.0
[planner]
pattern = "lawnmower"
swaths = 2
"""
DEM_MISSION = MISSION.replace(
    'source = "random"\nsize_m = 150.0\nstep_m = 3.0', 'source = "dem"\nfile = "dem.tif"'
)
STUDY = """
schema_version = 1
name = "s"
trials = 2
swaths = [2]
[[terrains]]
name = "smooth"
family = "squared-exponential"
source = "random"
length_scale_m = 50.0
[[planners]]
pattern = "lawnmower"
"""
PLACE = Affine(STEP_M, 0.0, WEST, 0.0, -STEP_M, SOUTH + SIDE_M)


def hills(n: int = 50) -> np.ndarray:
    """Return heights (n, n) [m] of gentle ground."""
    x, y = np.meshgrid(np.arange(n) / 8.0, np.arange(n) / 11.0)
    return 100.0 + 3.0 * np.sin(x) * np.cos(y)


def write_raster(
    path: Path, values: np.ndarray, crs: object = UTM, transform: Affine = PLACE, **profile: object
) -> None:
    """Write a GeoTIFF without any of firnline's checks; ``values`` are (rows, columns) or (bands, rows, columns)."""
    bands = values if values.ndim == 3 else values[None]
    settings = {"dtype": "float32", "nodata": -9999.0, "driver": "GTiff", **profile}
    with rasterio.open(
        path,
        "w",
        count=len(bands),
        height=bands.shape[1],
        width=bands.shape[2],
        crs=crs,
        transform=transform,
        **settings,
    ) as target:
        target.write(bands.astype(settings["dtype"]))


def raster(name: str, offset_m: float = 0.0) -> Prepare:
    """Return a preparation that writes a good raster."""

    def prepare(folder: Path) -> None:
        write_raster(folder / name, hills() + offset_m)

    return prepare


def points_text(n: int = 6) -> str:
    """Return n² good points as CSV."""
    rows = [
        f"{WEST + 25.0 * i + 1.0:.1f},{SOUTH + 24.0 * j + 2.0:.1f},{100.0 + i - j:.2f},0.1"
        for i in range(n)
        for j in range(n)
    ]
    return "x_m,y_m,z_m,sigma_z_m\n" + "\n".join(rows) + "\n"


def points(folder: Path) -> None:
    """Write points.csv."""
    (folder / "points.csv").write_text(points_text())


def polygon() -> shapely.Polygon:
    """Return the site without a rim."""
    return shapely.box(WEST + 6.0, SOUTH + 6.0, WEST + SIDE_M - 6.0, SOUTH + SIDE_M - 6.0)


def area(folder: Path) -> None:
    """Write area.gpkg."""
    SurveyArea(polygon(), UTM).write(folder / "area.gpkg")


def write_shape(path: Path, shape: shapely.Geometry, role: str = "area", crs: str = UTM) -> None:
    """Write one shape with a role, unchecked."""
    shapes, roles = ([shape], [role]) if role == "area" else ([polygon(), shape], ["area", role])
    write_features(path, shapes, {"role": np.array(roles, dtype=object)}, CRS(crs), layer="area")


GOOD = both(
    area,
    raster("dem.tif"),
    raster("map.tif", 0.1),
    points,
    text("m.toml", MISSION),
    text("s.toml", STUDY),
)
"""Writes an input for each of `GOOD_COMMANDS`."""
GOOD_COMMANDS: tuple[list[str], ...] = (
    ["plan", "area.gpkg", "--prior", "dem.tif", "-q"],
    ["reconstruct", "points.csv", "--crs", UTM, "--grid", "10", "-q", "-o", "gp"],
    ["reconstruct", "points.csv", "--crs", UTM, "--grid", "10", "--method", "tin", "-q", "-o", "tin"],
    ["score", "map.tif", "--truth", "dem.tif", "--area", "area.gpkg", "-q"],
    ["score", "map.tif", "--checkpoints", "points.csv", "-q"],
    ["change", "map.tif", "dem.tif", "--outline", "area.gpkg", "-o", "change"],
    ["export", "points.csv", "points.ply", "--as", "points", "--crs", UTM],
    ["export", "dem.tif", "dem.asc"],
    ["init", "new.toml", "--dem", "dem.tif"],
    ["run", "m.toml", "--runs", "runs", "-q"],
    ["montecarlo", "s.toml", "--runs", "runs", "--engine", "serial", "-q"],
)
"""Commands that succeed."""
