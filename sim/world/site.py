"""World of a mission: real terrain, prior elevations, and the area to survey.

`build_world` draws the terrain or reads it, cuts the area, and makes the prior: cells of the terrain with the errors of
a satellite product, or a raster from a file.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import shapely
from affine import Affine
from rasterio.features import shapes
from scipy.ndimage import distance_transform_edt

from sim.config.mission import MissionConfig
from sim.config.world import DemTerrain, RandomTerrain, SampleTerrain, SatelliteConfig
from survey import Dem, Grid, InputError, SurveyArea
from survey import terrain as landforms
from survey.core import DataObject, FloatArray, projected_crs, same_vertical_datum, stream
from survey.core.transformation import is_geographic
from survey.io.raster import Raster, raster_header, reproject
from survey.terrain.real import sample_site
from survey.terrain.satellite import ProductErrors, SatelliteDem, product_copy, smooth_interpolation


@dataclass(frozen=True, eq=False, repr=False)
class World(DataObject):
    """World of a mission.

    Parameters
    ----------
    terrain : Dem
        Real terrain, at the resolution of the simulation.
    prior : Dem
        Coarse satellite elevations, available to planner and reconstruction.
    area : SurveyArea
        Area to survey, in the terrain's CRS.
    """

    terrain: Dem
    prior: Dem
    area: SurveyArea


@dataclass
class SharedWorld:
    """World of a mission, which is built when it is first needed, and once.

    Parameters
    ----------
    mission : MissionConfig
        The mission.

    Examples
    --------
    >>> mission = MissionConfig.model_validate(
    ...     {"schema_version": 1, "name": "a", "terrain": {"source": "srtm-sample"}, "planner": {"pattern": "lawnmower", "swaths": 2}}
    ... )
    >>> world = SharedWorld(mission)
    >>> world.get() is world.get()
    True
    """

    mission: MissionConfig
    _world: World | None = field(default=None, init=False, repr=False, compare=False)

    def get(self) -> World:
        """Return the world.

        Returns
        -------
        World
            Terrain, prior and survey area.
        """
        if self._world is None:
            self._world = build_world(self.mission)
        return self._world

    def release(self) -> None:
        """Free the memory; the world is built again when it is needed."""
        self._world = None


def build_world(mission: MissionConfig) -> World:
    """Build the world of a mission: terrain, satellite prior, and survey area.

    Parameters
    ----------
    mission : MissionConfig
        Its sections ``terrain``, ``satellite`` and ``area``, and its seed.

    Returns
    -------
    World
        Terrain, prior and area in one projected CRS.

    Raises
    ------
    InputError
        The area leaves the terrain or holds unknown ground.
    """
    return _built(
        mission, tuple((str(file.absolute()), *_state(file)) for file in mission.input_files.values())
    )


def _state(file: Path) -> tuple[int, int]:
    """Return time of the last change [ns] and size of a file; zeros of one that is missing."""
    try:
        facts = file.stat()
    except OSError:
        return 0, 0
    return facts.st_mtime_ns, facts.st_size


@lru_cache(maxsize=1)  # checked once, then used by two stages
def _built(mission: MissionConfig, files: tuple[tuple[str, int, int], ...]) -> World:
    """Build a world; the key of the cache holds the state of its input files."""
    del files
    match mission.terrain:
        case RandomTerrain() as config:
            terrain = _random_terrain(config, mission.seed)
            return _surveyed(mission, terrain, None)
        case SampleTerrain() as config:
            prior, bounds = sample_site()
            grid = Grid(bounds, config.step_m, prior.crs)
            return _surveyed(mission, smooth_interpolation(prior, grid), prior.window(bounds))
        case DemTerrain() as config:
            dem = Dem.read(mission.path(config.file), crs=config.crs, vertical_datum=config.vertical_datum)
            if config.role == "truth":
                return _surveyed(mission, dem, None)
            xmin, ymin, xmax, ymax = dem.grid().bounds
            step = config.step_m
            columns, rows = int((xmax - xmin) / step + 1e-9), int((ymax - ymin) / step + 1e-9)
            grid = Grid((xmin, ymax - rows * step, xmin + columns * step, ymax), step, dem.crs)
            return _surveyed(mission, smooth_interpolation(dem, grid), dem)


def _random_terrain(config: RandomTerrain, seed: int) -> Dem:
    x, y = config.origin_m
    grid = Grid(
        (x, y, x + config.size_m, y + config.size_m),
        config.step_m,
        projected_crs(config.crs, "the random terrain"),
    )
    scale = {} if config.family not in _SCALED else {"length_scale_m": config.length_scale_m}
    return landforms.random_dem(
        config.family, grid, stream(seed, "terrain"), relief_m=config.relief_m, **scale
    )


_SCALED = ("squared-exponential", "matern-3/2", "matern-5/2")


def _surveyed(mission: MissionConfig, terrain: Dem, prior: Dem | None) -> World:
    area = _area(mission, terrain)
    if mission.satellite.file is not None:
        prior = prior_from_file(mission, terrain, area)
    elif prior is None:
        prior = _satellite_copy(mission, terrain, area)
    terrain = _around(terrain, area)
    return World(_with_micro_relief(mission, terrain), prior, area)


def _area(mission: MissionConfig, terrain: Dem) -> SurveyArea:
    config = mission.area
    if config.file is not None:
        area = SurveyArea.read(mission.path(config.file), crs=terrain.crs, select=config.select)
    else:
        area = SurveyArea.rectangle(config.bounds_m or terrain.bounds, terrain.crs)
        if config.bounds_m is None and isinstance(mission.terrain, RandomTerrain | SampleTerrain):
            area = SurveyArea.rectangle(terrain.grid().bounds, terrain.crs)
    if config.starts_m:
        area = replace(area, starts=np.array(config.starts_m))
    known = _footprint(terrain)
    if known.buffer(1e-6).covers(area.polygon):
        return area
    outside = area.polygon.difference(known).area / area.polygon.area
    if not config.clip_to_terrain:
        raise InputError(
            f"{100.0 * outside:.1f} % of the survey area has no known terrain (nodata or outside the raster, whose bounds "
            f"are {tuple(round(b, 1) for b in terrain.bounds)}); choose another area or set area.clip_to_terrain = true."
        )
    return _clipped(area, known, terrain.step_m)


def _footprint(terrain: Dem) -> shapely.Geometry:
    """Return the outline of the cells with a height."""
    valid = np.isfinite(terrain.elevation)
    if valid.all():
        return shapely.box(*terrain.bounds)
    cells = shapes(valid.astype(np.uint8), mask=valid, transform=terrain.transform)
    return shapely.union_all([shapely.geometry.shape(outline) for outline, _ in cells])


def _clipped(area: SurveyArea, known: shapely.Geometry, step_m: float) -> SurveyArea:
    """Return the largest part of the area with known heights, a cell and a half inside for interpolation."""
    inside = area.polygon.intersection(known.buffer(-1.5 * step_m)).simplify(0.5 * step_m)
    parts = [part for part in shapely.get_parts(inside) if part.geom_type == "Polygon" and part.area > 0.0]
    if not parts:
        raise InputError("the survey area and the known terrain do not overlap; choose another area.")
    largest = max(parts, key=lambda part: part.area)
    starts = [start for start in area.starts if largest.covers(shapely.Point(start))]
    return SurveyArea(largest, area.crs, area.no_go, np.array(starts).reshape(-1, 2))


def _around(terrain: Dem, area: SurveyArea, margin_m: float = 30.0) -> Dem:
    """Crop the terrain to the area and a margin in view of the camera."""
    xmin, ymin, xmax, ymax = area.bounds
    return terrain.window((xmin - margin_m, ymin - margin_m, xmax + margin_m, ymax + margin_m))


def _satellite_copy(mission: MissionConfig, terrain: Dem, area: SurveyArea) -> Dem:
    """Return coarse cells over the area; empty ones take the value of the nearest cell."""
    cell_m = _whole_cells(mission.satellite.cell_m, terrain.step_m)
    xmin, ymin, xmax, ymax = area.bounds
    sides = (xmax - xmin) / cell_m, (ymax - ymin) / cell_m
    if any(abs(side - round(side)) > 1e-6 for side in sides):
        # The map's grid may reach a step beyond an irregular area: half a cell more on every side holds it.
        xmin, ymin, xmax, ymax = xmin - cell_m / 2, ymin - cell_m / 2, xmax + cell_m / 2, ymax + cell_m / 2
    columns, rows = _even((xmax - xmin) / cell_m), _even((ymax - ymin) / cell_m)
    padded = _padded(terrain, (xmin, ymax - rows * cell_m, xmin + columns * cell_m, ymax))
    satellite = mission.satellite.model_copy(update={"cell_m": cell_m})
    rng, errors_rng = stream(mission.seed, "satellite"), stream(mission.seed, "satellite", "errors")
    coarse = erroneous_copy(padded, satellite, rng, errors_rng)
    return Dem(_continued(coarse.elevation), coarse.transform, coarse.crs, coarse.vertical_datum)


def _even(cells: float) -> float:
    """Return the next even number of cells: with half cells too the edges then meet."""
    return 2.0 * float(np.ceil(0.5 * cells - 1e-6))


def _whole_cells(cell_m: float, step_m: float) -> float:
    """Return the satellite's cell as half a whole number of fine ones, which it must be to one part in a thousand."""
    whole = max(round(2.0 * cell_m / step_m), 2) * 0.5 * step_m
    if abs(whole - cell_m) > 1e-3 * cell_m:
        raise InputError(
            f"satellite cells of {cell_m:g} m do not fit the terrain's {step_m:g} m cells; "
            f"set satellite.cell_m = {whole:.6g}."
        )
    return whole


def _padded(terrain: Dem, bounds: tuple[float, float, float, float]) -> Dem:
    """Return the cells within bounds, NaN where the raster does not reach.

    Bounds that run through cell centres take both outer ones, as a grid's nodes do; others
    are moved to the nearest cell edge.
    """
    xmin, ymin, xmax, ymax = bounds
    step = terrain.step_m
    first_column, columns = _span((xmin - terrain.bounds[0]) / step, (xmax - xmin) / step)
    first_row, rows = _span((terrain.bounds[3] - ymax) / step, (ymax - ymin) / step)
    values = np.full((rows, columns), np.nan)
    r0, c0 = max(first_row, 0), max(first_column, 0)
    r1, c1 = min(first_row + rows, terrain.shape[0]), min(first_column + columns, terrain.shape[1])
    values[r0 - first_row : r1 - first_row, c0 - first_column : c1 - first_column] = terrain.elevation[
        r0:r1, c0:c1
    ]
    transform = terrain.transform @ Affine.translation(first_column, first_row)
    return Dem(values, transform, terrain.crs, terrain.vertical_datum)


def _span(offset: float, width: float) -> tuple[int, int]:
    """Return first cell and number of cells of an interval in cell widths from the raster's edge."""
    through_centres = abs(offset - np.floor(offset) - 0.5) < 1e-6
    first = int(np.floor(offset)) if through_centres else round(offset)
    return first, round(width) + int(through_centres)


def _continued(elevation: FloatArray) -> FloatArray:
    empty = ~np.isfinite(elevation)
    if not empty.any():
        return elevation
    rows, columns = distance_transform_edt(empty, return_distances=False, return_indices=True)
    nearest: FloatArray = elevation[rows, columns]
    return nearest


def _with_micro_relief(mission: MissionConfig, terrain: Dem) -> Dem:
    sd_m = mission.terrain.micro_relief_sd_m
    if sd_m == 0.0:
        return terrain
    relief = landforms.ice_micro_relief(terrain.grid(), stream(mission.seed, "micro-relief"), sd_m=sd_m)
    return Dem(terrain.elevation + relief, terrain.transform, terrain.crs, terrain.vertical_datum)


_MARGIN_CELLS = 4.0


def erroneous_copy(
    terrain: Dem, satellite: SatelliteConfig, rng: np.random.Generator, errors_rng: np.random.Generator
) -> SatelliteDem:
    """Return block means of a terrain with the errors that the settings draw."""
    errors = ProductErrors.drawn(satellite.errors(), errors_rng)
    return product_copy(terrain, errors, rng=rng, cell_m=satellite.cell_m, correlated_rng=errors_rng)


def prior_from_file(mission: MissionConfig, terrain: Dem, area: SurveyArea) -> Dem:
    """Read the prior that a mission names, in the terrain's CRS and about the area."""
    config = mission.satellite
    assert config.file is not None
    file = mission.path(config.file)
    stated = raster_header(file).crs if config.crs is None else config.crs
    crs = terrain.crs if is_geographic(stated) else config.crs
    prior = Dem.read(file, crs=crs, vertical_datum=config.vertical_datum)
    same_vertical_datum(
        prior.vertical_datum, terrain.vertical_datum, "the satellite's raster and the terrain"
    )
    if not prior.crs.equals(terrain.crs, ignore_axis_order=True):
        warped = reproject(
            Raster(prior.elevation, prior.transform, prior.crs, prior.vertical_datum),
            terrain.crs,
            prior.step_m,
        )
        prior = Dem(warped.values, warped.transform, terrain.crs, prior.vertical_datum)
    return _about(prior, area, config.file)


def _about(prior: Dem, area: SurveyArea, name: str) -> Dem:
    """Return the cells about an area; refuse a prior that does not cover it."""
    xmin, ymin, xmax, ymax = area.bounds
    corners = np.array([[xmin, ymin], [xmin, ymax], [xmax, ymin], [xmax, ymax]])
    nodes = prior.xy[area.contains(prior.xy)]
    heights = prior.at(np.vstack([corners, nodes]))
    if np.isnan(heights).any():
        raise InputError(
            f"satellite.file {name} has no height at {int(np.isnan(heights).sum())} of {len(heights)} places of the survey "
            "area; take a raster that covers it."
        )
    margin_m = _MARGIN_CELLS * prior.step_m
    return prior.window((xmin - margin_m, ymin - margin_m, xmax + margin_m, ymax + margin_m))
