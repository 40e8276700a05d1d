"""Simulated pairs of surveys whose change of volume is known, and a real one."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from scipy.fft import irfft2, rfft2

from survey.core.arrays import FloatArray
from survey.core.map_scale import areal_factors, ground_area_m2, scale_factors
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain, quadrature
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.scoring.differencing.difference import change, change_of_models
from survey.scoring.differencing.volume_change import VolumeChange

UTM = "EPSG:32608"


class World(NamedTuple):
    """Errors of a difference: white, and exponentially correlated at two lengths; and how large the glacier is."""

    n_cells: int = 200
    step_m: float = 5.0
    white_m: float = 0.1
    short: tuple[float, float] = (0.2, 30.0)
    long: tuple[float, float] = (0.3, 150.0)
    radius_m: float = 180.0


class Judged(NamedTuple):
    """What one pair showed: error of the volume, stated and naive deviation, and if the 95 % intervals hold."""

    error_m3: float
    std_m3: float
    holds: bool
    naive_holds: bool
    naive_std_m3: float


def judged(found: VolumeChange, true_m3: float) -> Judged:
    """Hold a volume change against the true one."""
    error = found.volume_m3 - true_m3
    return Judged(
        error,
        found.std_m3,
        abs(error) <= found.half_width_95_m3,
        abs(error) <= 1.959964 * found.naive_std_m3,
        found.naive_std_m3,
    )


def raster_pair(seed: int, world: World) -> Judged:
    """Compare two rasters: a glacier that sank unevenly, an offset, and correlated errors everywhere."""
    rng = stream(seed, "change of rasters")
    n, step = world.n_cells, world.step_m
    grid = Grid((0.0, 0.0, (n - 1) * step, (n - 1) * step), step, UTM)
    centre = 0.5 * n * step
    outline = shapely.Point(centre, 0.97 * centre).buffer(world.radius_m, quad_segs=32)
    x, y = np.meshgrid(grid.x, grid.y)
    inside = shapely.contains_xy(outline, *grid.xy.T).reshape(grid.shape)
    sunk = np.where(inside, -3.0 + np.sin(x / 90.0) + 0.5 * np.cos(y / 60.0), 0.0)
    errors = world.white_m * rng.standard_normal(grid.shape) + 0.5 * rng.standard_normal()
    for size, length in (world.short, world.long):
        errors += size * exponential_field(rng, n, length / step)
    terrain = 100.0 + 0.1 * x + 8.0 * np.sin(y / 70.0)
    found = change(
        Dem.on(grid, terrain + sunk + errors), Dem.on(grid, terrain), {"glacier": outline}
    ).volumes[0]
    ground = 1.0 / areal_factors(grid.crs, grid.x, grid.y)
    mean_m = np.average(sunk[inside], weights=ground[inside])
    return judged(found, float(mean_m) * ground_area_m2(grid.crs, outline))


def exponential_field(rng: np.random.Generator, n: int, length_cells: float) -> FloatArray:
    """Draw a field (n, n) of variance 1 whose correlation falls off as exp(-h / length)."""
    m = 2 * n
    k2 = (2.0 * np.pi) ** 2 * (np.fft.fftfreq(m)[:, None] ** 2 + np.fft.rfftfreq(m)[None] ** 2)
    density = (1.0 + k2 * length_cells**2) ** -1.5
    field: FloatArray = irfft2(rfft2(rng.standard_normal((m, m))) * np.sqrt(density), (m, m))[:n, :n]
    mean_density = np.mean(np.r_[density.ravel(), density[:, 1:-1].ravel()])
    return field / np.sqrt(mean_density)


def model_pair(seed: int, *, n_points: int = 120, shared: float = 0.0) -> Judged:
    """Compare two terrain models of surveys at random places; the terrains share a part of their relief."""
    rng = stream(seed, "change of models")
    side, kernel, sigma = 300.0, SquaredExponential(4.0, 40.0), 0.1
    grid = Grid((0.0, 0.0, side, side), 10.0, UTM)
    outline = shapely.Point(150.0, 140.0).buffer(90.0)
    nodes, areas = quadrature(outline, grid.step_m)
    places = [rng.uniform(0.0, side, (n_points, 2)) for _ in range(2)]
    everywhere = np.vstack([*places, nodes])
    root = np.linalg.cholesky(kernel.covariance(everywhere, everywhere) + 1e-8 * np.eye(len(everywhere)))
    common, *own = (root @ rng.standard_normal(len(everywhere)) for _ in range(3))
    terrains = [100.0 + np.sqrt(shared) * common + np.sqrt(1.0 - shared) * part for part in own]
    config = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=40.0)
    models = []
    for k, terrain in enumerate(terrains):
        z = terrain[k * n_points : (k + 1) * n_points] + sigma * rng.standard_normal(n_points)
        points = SurfacePoints(np.column_stack([places[k], z]), sigma_m=sigma, crs=UTM)
        models.append(GaussianProcessTerrain(config, bounds=grid.bounds).fit(points))
    found = change_of_models(models[1], models[0], {"site": outline}, grid).volumes[0]
    areas = areas / scale_factors(UTM, nodes).areal
    true_m3 = float(areas @ (terrains[1] - terrains[0])[2 * n_points :])
    return judged(found, true_m3)


class Landslide(NamedTuple):
    """How well a real change was recovered."""

    worst_m: float
    volume_off: float
    noisy_off_in_half_widths: float


def landlab_pair(data: Path) -> Landslide:
    """Recover a real landslide's change: exactly from exact surveys, and within its interval from noisy ones."""
    folder = data / "dem_landlab_repeat_and_lidar"
    crs = "EPSG:32610"
    before = Dem.read(folder / "pre_runout_DEM.asc", crs=crs)
    moved = Dem.read(folder / "DEM_of_Difference.asc", crs=crs).elevation
    grid, x, y = before.grid(), before.x[None, :], before.y[:, None]
    cells = shapely.box(x - 5.0, y - 5.0, x + 5.0, y + 5.0)[np.isfinite(moved)]
    outline = {"runout": shapely.union_all(cells)}
    after = Dem.on(grid, before.elevation + np.nan_to_num(moved))
    exact = change(after, before, outline)
    true_m3 = float(np.nansum(moved / areal_factors(crs, grid.x, grid.y))) * 100.0
    rng = stream(7, "noisy landslide")
    noisy = [Dem.on(grid, dem.elevation + rng.normal(0.0, 0.3, grid.shape)) for dem in (after, before)]
    found = change(*noisy, outline).volumes[0]
    return Landslide(
        float(np.nanmax(np.abs(exact.difference.elevation - moved))),
        abs(exact.volumes[0].volume_m3 / true_m3 - 1.0),
        abs(found.volume_m3 - true_m3) / found.half_width_95_m3,
    )
