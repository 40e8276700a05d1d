"""Windows of real ground: which there are, and the coarse prior that is known of each.

The rule, written before any survey was made: each landscape is tiled with squares from its north-west corner;
squares with a height on 99.5 % of their cells are windows, at most nine of them, taken evenly. Their priors are
the real coarse product where one stands beside; else means over cells of 30 m for even and 60 m for odd
windows (30 m where the window is 150 m wide), with the errors that such products have: smoothed over two cells,
shifted, with white, correlated and common errors. Landscapes, not windows, are split into development and judgement.

The stated standard deviation of a prior's cell is 1 m, but 10 m for that of the crater, which is four years and an
eruption old: its source states that the ground has changed by tens of metres since.

Three landscapes joined later by the same rule, before any survey of them: an alpine bowl for development, which had
no steep ground, a wooded slope (ground returns of lidar) and a dry gully for judgement. The judgement windows of the
five older landscapes had been surveyed with earlier settings by then.

A landslide slope (10 m cells, no CRS stated) was added by the same rule when the judgement windows of all others had been
surveyed with earlier settings: it is fresh ground, in rows of its own.

The shifted windows were added before their first survey, when all of the above had been surveyed: squares of the same
landscapes that begin half a side farther east and south, at most three of each, in rows of their own. A quarter of each
lies in a window above.
"""

import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import rasterio
from affine import Affine
from rasterio.warp import Resampling, reproject
from scipy.ndimage import distance_transform_edt, gaussian_filter

from benchmarks.promise_on_real_ground.ground_points import ground_dem
from survey import Dem, Grid, SurveyArea
from survey.core.arrays import FloatArray
from survey.core.streams import stream

SEED = 31_415
FOLDER = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
WHITE_M, CORRELATED_M, CORRELATION_M, DATUM_M, SHIFT_CELLS = 0.5, 1.0, 250.0, 0.5, 0.3
"""Errors of the priors made here: independent, correlated with its length, common; shift east and north."""
SMOOTHED_CELLS = 2.0
"""Full width at half maximum of what a cell of the priors made here shows, in cells."""
_POINTS_M = 2.0
_KNOWN = 0.995


@dataclass(frozen=True)
class Landscape:
    """Fine DEM of one landscape, the side of its windows, and the limit that is asked for there.

    A file without a CRS is read in `crs`; `corner_m` is added to coordinates that count from the file's corner. The first
    square begins `shift` sides from the north-west corner, and at most `most` of them are windows.
    """

    name: str
    file: str
    side_m: float
    half: Literal["development", "judgement", "fresh", "shifted"]
    coarse: str = ""
    limit_m: float = 0.4572
    prior_sigma_m: float = 1.0
    crs: str | None = None
    corner_m: tuple[float, float] = (0.0, 0.0)
    shift: float = 0.0
    most: int = 9


_LANDSCAPES = (
    Landscape("hills", "dem_slovenia_lidar_1m/TM1_564_146.tif", 300.0, "development"),
    Landscape("drumlins", "dem_drumlins_ny_2m/dem_2m.tif", 300.0, "development"),
    Landscape("lake shore", "dem_debrisflow_kelowna_1m/dem_1m.tif", 150.0, "development"),
    Landscape(
        "alpine bowl", "dem_avaframe_tirol/avaHit.asc", 300.0, "development", limit_m=1.0, crs="EPSG:31287"
    ),
    Landscape("tundra", "dem_subarctic_alpine_granger_1m/dem_1m.tif", 300.0, "judgement"),
    Landscape("gullied sand", "dem_gully_fortbragg_3epochs/elevation_2016_1m.tif", 150.0, "judgement"),
    Landscape(
        "grazed gullies",
        "dem_gullies_santacruz_pozo/pozo_cat17_ground_1m.tif",
        150.0,
        "judgement",
        "dem_gullies_santacruz_pozo/pozo_dem_28m.tif",
    ),
    Landscape("alpine slope", "dem_avaframe_tirol/avaAlr.tif", 300.0, "judgement", limit_m=1.0),
    Landscape(
        "volcano crater",
        "dem_volcano_msh_crater_series/msh_20041013_2m.tif",
        150.0,
        "judgement",
        "dem_volcano_msh_crater_series/msh_20000925_10m.tif",
        limit_m=1.0,
        prior_sigma_m=10.0,
    ),
    Landscape("wooded slope", "lidar_bcts_3strips", 150.0, "judgement", crs="EPSG:3005"),
    Landscape(
        "dry gully",
        "dem_landlab_repeat_and_lidar/bijou_gully_subset_5m_edit_dx_filled.asc",
        150.0,
        "judgement",
        crs="EPSG:32613",
        corner_m=(560_000.0, 4_372_000.0),
    ),
    Landscape(
        "landslide slope",
        "dem_landlab_repeat_and_lidar/pre_runout_DEM.asc",
        300.0,
        "fresh",
        crs="EPSG:32610",
        corner_m=(0.0, 5_100_000.0),
    ),
)
LANDSCAPES = _LANDSCAPES + tuple(
    replace(one, name=f"{one.name} shifted", half="shifted", shift=0.5, most=3)
    for one in _LANDSCAPES
    if one.half != "development"
)


@dataclass(frozen=True)
class Site:
    """Terrain of a window, the area on it, its prior, the limit of the map's error, and the prior's deviation [m]."""

    terrain: Dem
    area: SurveyArea
    prior: Dem
    limit_m: float
    prior_sigma_m: float = 1.0

    @property
    def grid(self) -> Grid:
        """Nodes (20, 20) where maps are judged."""
        xmin, ymin, xmax, _ = self.area.bounds
        step_m = (xmax - xmin) / 20.0
        inner = (xmin + 0.5 * step_m, ymin + 0.5 * step_m, xmin + 19.5 * step_m, ymin + 19.5 * step_m)
        return Grid(inner, step_m, self.area.crs)

    @property
    def nodes(self) -> FloatArray:
        """Places (400, 2) where maps are judged [m]."""
        return self.grid.xy


def fine_dem(name: str) -> Dem:
    """Return the fine DEM of a landscape."""
    landscape = landscape_of(name)
    return _read(landscape.file, landscape.crs, landscape.corner_m)


@cache
def _read(name: str, crs: str | None, corner_m: tuple[float, float]) -> Dem:
    """Read the DEM of a file, or of the ground points of a folder."""
    file = FOLDER / name
    if file.is_dir():
        return ground_dem(file, _POINTS_M, str(crs))
    dem = Dem.read(file, crs=crs)
    return replace(dem, transform=Affine.translation(*corner_m) @ dem.transform)


def landscape_of(name: str) -> Landscape:
    """Return a landscape by its name."""
    return next(one for one in LANDSCAPES if one.name == name)


@cache
def windows(name: str) -> tuple[tuple[float, float, float, float], ...]:
    """Return the bounds of a landscape's windows [m]."""
    dem, landscape = fine_dem(name), landscape_of(name)
    side_m, first_m = landscape.side_m, landscape.shift * landscape.side_m
    west, south, east, north = np.array(dem.bounds) + [first_m, 0.0, 0.0, -first_m]
    found = []
    for row in range(int((north - south) // side_m)):
        for column in range(int((east - west) // side_m)):
            left, top = west + column * side_m, north - row * side_m
            if _known_share(dem, row + landscape.shift, column + landscape.shift, side_m) >= _KNOWN:
                found.append((left, top - side_m, left + side_m, top))
    chosen = np.linspace(0, len(found) - 1, min(len(found), landscape.most)).round().astype(int)
    return tuple(found[index] for index in chosen)


def _known_share(dem: Dem, row: float, column: float, side_m: float) -> float:
    """Return the share of a square's cells with a height; it begins so many sides from the north-west corner."""
    n = int(side_m / dem.step_m)
    top, left = int(row * n), int(column * n)
    cells = dem.elevation[top : top + n, left : left + n]
    return float(np.isfinite(cells).mean())


@cache
def site_of(name: str, index: int) -> Site:
    """Return one window of a landscape with its prior."""
    landscape, bounds = landscape_of(name), windows(name)[index]
    terrain = filled(fine_dem(name).window(bounds))
    edge_m = 1.5 * terrain.step_m
    xmin, ymin, xmax, ymax = bounds
    area = SurveyArea.rectangle(
        (xmin + edge_m, ymin + edge_m, xmax - edge_m, ymax - edge_m), fine_dem(name).crs
    )
    prior = _real_prior(landscape, bounds) if landscape.coarse else _made_prior(name, index)
    return Site(terrain, area, prior, landscape.limit_m, landscape.prior_sigma_m)


def filled(dem: Dem) -> Dem:
    """Return the window with its few unknown cells as high as the nearest known ones."""
    unknown = ~np.isfinite(dem.elevation)
    if not unknown.any():
        return dem
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return Dem(dem.elevation[tuple(nearest)], dem.transform, dem.crs)


def _real_prior(landscape: Landscape, bounds: tuple[float, float, float, float]) -> Dem:
    """Return the real coarse product about a window, on square cells; 0 is no data in one of the products."""
    with rasterio.open(FOLDER / landscape.coarse) as file:
        cell_m, values = round(file.res[0]), file.read(1).astype(np.float64)
        xmin, _, xmax, ymax = bounds
        n = int(np.ceil((xmax - xmin) / cell_m)) + 2
        transform = Affine(cell_m, 0.0, xmin - cell_m, 0.0, -cell_m, ymax + cell_m)
        heights = np.full((n, n), np.nan)
        reproject(
            np.where(values == 0.0, np.nan, values),
            heights,
            src_transform=file.transform,
            src_crs=file.crs,
            src_nodata=np.nan,
            dst_transform=transform,
            dst_crs=file.crs,
            dst_nodata=np.nan,
            resampling=Resampling.bilinear,
        )
    return Dem(heights, transform, fine_dem(landscape.name).crs)


def _made_prior(name: str, index: int) -> Dem:
    """Return what a coarse product would show of a window, with its errors."""
    dem, (xmin, ymin, xmax, ymax) = fine_dem(name), windows(name)[index]
    cell_m = 60.0 if index % 2 and xmax - xmin >= 300.0 else 30.0
    pad_m = 3.0 * cell_m
    near = dem.window((xmin - pad_m, ymin - pad_m, xmax + pad_m, ymax + pad_m))
    known = np.isfinite(near.elevation)
    sigma = SMOOTHED_CELLS / 2.355 * cell_m / dem.step_m
    weight = gaussian_filter(known.astype(float), sigma, mode="nearest")
    smooth = gaussian_filter(np.where(known, near.elevation, 0.0), sigma, mode="nearest") / np.maximum(
        weight, 1e-6
    )
    rng = stream(SEED, "prior", name, index)
    n = round((xmax - xmin) / cell_m)
    east = xmin + cell_m * (np.arange(n) + 0.5)
    north = ymax - cell_m * (np.arange(n) + 0.5)
    xy = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    west, south, right, top = near.grid().bounds
    shown = np.clip(xy + SHIFT_CELLS * cell_m * rng.standard_normal(2), [west, south], [right, top])
    heights = Dem(smooth, near.transform, near.crs).at(shown) + _errors(xy, rng)
    return Dem(heights.reshape(n, n), Affine(cell_m, 0.0, xmin, 0.0, -cell_m, ymax), dem.crs)


def _errors(xy: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the errors (N,) of the cells at places (N, 2) [m]."""
    squared = np.square(xy[:, None] - xy).sum(axis=-1)
    covariance = CORRELATED_M**2 * np.exp(-squared / CORRELATION_M**2) + 1e-6 * np.eye(len(xy))
    correlated = np.linalg.cholesky(covariance) @ rng.standard_normal(len(xy))
    errors: FloatArray = correlated + WHITE_M * rng.standard_normal(len(xy)) + DATUM_M * rng.standard_normal()
    return errors
