"""Small files for the console transcripts: a site, its satellite elevations, maps, checkpoints and two surveys.

| file | content |
|---|---|
| site.geojson, site.gpkg, site.kml | an area of 600 m by 600 m (the KML in degrees) |
| srtm.tif, glo30.tif | coarse elevations around it, cells of 60 m and of 30 m |
| lidar.tif | the true surface, cells of 5 m |
| map.tif | a map of it with its standard deviation as second band |
| gnss.csv | 36 checkpoints as a receiver exports them |
| landmarks.csv | 300 surface points with their standard deviation |
| cover.gpkg | polygons of ice and rock |
| scans | two LiDAR scans of a few square metres |
| weather.csv | air temperature along four lines |
| line.geojson, seen.csv | a swath across a ditch, and the points that a scanner saw there |
| serac.ply | an ice face that leans over the ground, scanned from two places |
| gamma.csv | counts of radiation on eight lines |
| scanned, localized | images and scans along 8 m of a tilted plane, and their localization |
| 2026.tif, 2024.tif, glacier.gpkg | two surveys, the outline of a glacier |
| 2026.laz, 2024.laz | point clouds of two surveys |
"""

from pathlib import Path

import numpy as np
import pyproj
import shapely

from sim.instruments.counter import RadiationWorld
from survey import Dem, Grid, Leg, Route, SurfacePoints, SurveyArea
from survey.core.arrays import FloatArray
from survey.io.raster import write_raster
from survey.io.vector import write_features
from tests.vision_slam.tilted_plane import write_drive

CRS = "EPSG:32608"
PROJECTED = pyproj.CRS(CRS)
WEST, SOUTH, SIDE = 500_000.0, 6_700_000.0, 600.0
DATUM = "EGM96 height"


def surface(x: FloatArray, y: FloatArray) -> FloatArray:
    """Height of the ground [m]: a slope with a few rounded hills."""
    e, n = x - WEST, y - SOUTH
    hills = 6.0 * np.sin(e / 95.0) * np.cos(n / 120.0) + 2.0 * np.sin((e + n) / 40.0)
    return 800.0 + 0.06 * e - 0.03 * n + hills


def grid(step_m: float, margin_m: float = 0.0) -> Grid:
    low, high = (WEST - margin_m, SOUTH - margin_m), (WEST + SIDE + margin_m, SOUTH + SIDE + margin_m)
    return Grid((*low, *high), step_m, CRS)


def ground(step_m: float, margin_m: float = 0.0) -> Dem:
    nodes = grid(step_m, margin_m)
    return Dem.on(nodes, surface(*np.meshgrid(nodes.x, nodes.y)), DATUM)


def make_scratch(folder: Path) -> None:
    """Write all files into an existing folder; they are the same each time."""
    rng = np.random.default_rng(7)
    area = SurveyArea.rectangle((WEST, SOUTH, WEST + SIDE, SOUTH + SIDE), CRS)
    for name in ("site.geojson", "site.gpkg", "site.kml"):
        area.write(folder / name)
    ground(60.0, 300.0).write(folder / "srtm.tif")
    ground(30.0, 300.0).write(folder / "glo30.tif")
    truth = ground(5.0)
    truth.write(folder / "lidar.tif")
    _write_map(folder / "map.tif", truth, rng)
    _write_checkpoints(folder / "gnss.csv", rng)
    _write_landmarks(folder / "landmarks.csv", rng)
    _write_cover(folder / "cover.gpkg")
    _write_surveys(folder, rng)
    _write_scans(folder / "scans", rng)
    _write_weather(folder / "weather.csv", rng)
    _write_clouds(folder, rng)
    _write_counts(folder / "gamma.csv")
    write_drive(folder)
    (folder / "drive").rename(folder / "scanned")
    write_ditch(folder)
    write_serac(folder / "serac.ply")


def write_serac(path: Path) -> None:
    """Write points of the ground and of a face 3 m high that leans over it by 26.6°, seen from two places."""
    rng = np.random.default_rng(8)
    y, t = rng.uniform(0.0, 4.0, 9000), rng.uniform(-3.0, 3.0, 9000)
    xyz = np.column_stack([np.where(t < 0.0, t, -0.5 * t), y, np.maximum(t, 0.0)])
    seen = xyz + 0.01 * rng.standard_normal(xyz.shape)
    origins = np.where(rng.random((9000, 1)) < 0.5, [-6.0, 1.0, 1.5], [-6.0, 3.0, 1.5])
    corner = np.array([WEST, SOUTH, 800.0])
    SurfacePoints(seen + corner, sigma_m=0.01, origins=origins + corner, crs=CRS).write(path)


def write_ditch(folder: Path) -> None:
    """Write a swath across a ditch 0.8 m wide that ends beside it, and points of the ground within 25 m."""
    rng = np.random.default_rng(12)
    xy = rng.uniform((-2.0, -9.0), (24.0, 9.0), (50_000, 2))
    z = 800.0 + 0.05 * xy[:, 0] + 0.02 * rng.standard_normal(len(xy))
    z[(np.abs(xy[:, 0] - 12.0) < 0.4) & (xy[:, 1] < 3.0)] -= 1.5
    seen = np.column_stack([WEST + xy[:, 0], SOUTH + xy[:, 1], z])
    np.savetxt(folder / "seen.csv", seen, "%.2f", delimiter=",", header="x_m,y_m,z_m", comments="")
    swath = Leg("swath", [[WEST, SOUTH], [WEST + 22.0, SOUTH]])
    Route((swath,), CRS, "line").write(folder / "line.geojson")


def _write_counts(path: Path) -> None:
    """Write counts of radiation on eight lines over a source."""
    east, north = np.meshgrid(WEST + np.arange(55.0, 155.0, 10.0), SOUTH + np.arange(10.0, 170.0, 20.0))
    source = np.array([WEST + 110.0, SOUTH + 80.0])
    world = RadiationWorld(source, 1e4, 10.0, np.random.default_rng(7), uneven=0.1)
    xy = np.column_stack([east.ravel(), north.ravel()])
    world.count(xy, np.full(len(xy), 10.0)).write(path)


def _write_map(path: Path, truth: Dem, rng: np.random.Generator) -> None:
    noise = rng.normal(0.0, 0.06, truth.shape)
    bands = {"elevation": truth.elevation + noise, "standard_deviation": np.full(truth.shape, 0.06)}
    write_raster(path, bands, truth.transform, truth.crs, DATUM)


def _write_checkpoints(path: Path, rng: np.random.Generator) -> None:
    """Write one checkpoint for each of 6 by 6 squares, with the columns of a receiver's export."""
    offsets = np.arange(50.0, SIDE, 100.0)
    x, y = (a.ravel() for a in np.meshgrid(WEST + offsets, SOUTH + offsets))
    x, y = x + rng.uniform(-10.0, 10.0, x.size), y + rng.uniform(-10.0, 10.0, x.size)
    z = surface(x, y) + rng.normal(0.0, 0.015, x.size)
    rows = [
        f"P{k},{e:.3f},{n:.3f},{h:.3f},0.010,0.015,ICE\n"
        for k, (e, n, h) in enumerate(zip(x, y, z, strict=True), 1)
    ]
    path.write_text("Point,Easting,Northing,Elevation,SDH,SDV,Code\n" + "".join(rows), encoding="utf-8")


def _write_landmarks(path: Path, rng: np.random.Generator) -> None:
    x, y = WEST + rng.uniform(0.0, SIDE, 300), SOUTH + rng.uniform(0.0, SIDE, 300)
    z = surface(x, y) + rng.normal(0.0, 0.1, 300)
    rows = [f"{e:.3f},{n:.3f},{h:.3f},0.1\n" for e, n, h in zip(x, y, z, strict=True)]
    path.write_text("x_m,y_m,z_m,sigma_z_m\n" + "".join(rows), encoding="utf-8")


def _write_cover(path: Path) -> None:
    """Write two polygons: ice in the west, rock in the east."""
    low, middle, high = (WEST - 10.0, SOUTH - 10.0), WEST + 300.0, (WEST + SIDE + 10.0, SOUTH + SIDE + 10.0)
    halves = [shapely.box(*low, middle, high[1]), shapely.box(middle, low[1], *high)]
    write_features(path, halves, {"class": np.array(["ice", "rock"], dtype=object)}, PROJECTED, layer="cover")


def _write_surveys(folder: Path, rng: np.random.Generator) -> None:
    """Write two surveys; the ice sank by 2 m between them, and each has an error of its own."""
    old = ground(10.0)
    ice = shapely.Point(WEST + 300.0, SOUTH + 300.0).buffer(150.0)
    on_ice = shapely.contains_xy(ice, *old.xy.T).reshape(old.shape)
    for name, sank in (("2024.tif", 0.0), ("2026.tif", 2.0)):
        heights = old.elevation - sank * on_ice + rng.normal(0.0, 0.2, old.shape)
        Dem(heights, old.transform, old.crs, DATUM).write(folder / name)
    names = {"name": np.array(["North glacier"], dtype=object)}
    write_features(folder / "glacier.gpkg", [ice], names, old.crs, layer="outlines")


def _write_clouds(folder: Path, rng: np.random.Generator) -> None:
    """Write two point clouds; the glacier sank by 2 m between them, and the later one lies 0.1 m too high."""
    for name, sank, off in (("2024.laz", 0.0, 0.0), ("2026.laz", 2.0, 0.1)):
        xy = np.array([WEST, SOUTH]) + rng.uniform(0.0, SIDE, (40_000, 2))
        on_ice = np.hypot(*(xy - (WEST + 300.0, SOUTH + 300.0)).T) < 150.0
        z = surface(*xy.T) - sank * on_ice + off + rng.normal(0.0, 0.05, len(xy))
        SurfacePoints(np.column_stack([xy, z]), sigma_m=0.05, crs=CRS, vertical_datum=DATUM).write(
            folder / name
        )


def _write_scans(folder: Path, rng: np.random.Generator) -> None:
    """Write two scans of the ground around a scanner 1.5 m above it."""
    folder.mkdir()
    for k in range(2):
        xy = np.array([WEST + 300.0 + 2.0 * k, SOUTH + 300.0]) + rng.uniform(-4.0, 4.0, (1500, 2))
        z = surface(*xy.T) + rng.normal(0.0, 0.03, len(xy))
        origin = np.append(xy.mean(axis=0), z.mean() + 1.5)
        np.savez(folder / f"{k}.npz", points=np.column_stack([xy, z]), origin=origin)


def _write_weather(path: Path, rng: np.random.Generator) -> None:
    """Write temperatures that fall by 6.5 K/km with elevation, along four lines."""
    x, y = (
        a.ravel()
        for a in np.meshgrid(WEST + np.linspace(50.0, 550.0, 60), SOUTH + 50.0 + 160.0 * np.arange(4))
    )
    temperature = -4.0 - 6.5e-3 * (surface(x, y) - 800.0) + rng.normal(0.0, 0.05, x.size)
    rows = [f"{e:.2f},{n:.2f},{t:.3f}\n" for e, n, t in zip(x, y, temperature, strict=True)]
    path.write_text("easting_m,northing_m,air_temperature\n" + "".join(rows), encoding="utf-8")
