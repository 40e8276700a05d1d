"""Sizes that missions and studies accept, estimated from the settings before the first stage.

Each limit keeps a stage within a few gigabytes of memory. Limits of the planners and of the
reconstruction methods stand in `planners.capacity` and `survey.reconstruction.capacity`.
"""

import math

from planners.capacity import require_cells
from planners.routes.rover import Crew, homes_of
from sim.config.mission import MissionConfig
from sim.config.sensors import InstrumentConfig
from sim.config.world import LARGEST_STEP_M, DemTerrain, RandomTerrain, SampleTerrain
from sim.world.site import SharedWorld, World
from survey import CapacityError, Dem
from survey.core import Bounds
from survey.reconstruction.capacity import smallest_step_m
from survey.reconstruction.registry import method_named

MOST_TERRAIN_CELLS = 50_000_000
"""Cells of simulated terrain; drawing them takes about 60 bytes each."""
MOST_SAMPLES = 500_000
"""Samples of the ideal sensor."""
MOST_LANDMARKS = 2_000_000
"""Landmarks of one drive."""
MOST_FRAMES = 500_000
"""Images of one drive."""
MOST_FINE_CELLS = 80_000_000
"""Cells of the fine ground that is driven on and rendered; about 50 bytes each."""
MOST_PHYSICS_STEPS = 20_000_000
"""Steps of the physics of one drive."""
MOST_READINGS = 20_000_000
"""Readings of one instrument on one drive."""
MOST_STAKES = 10_000
"""Stakes of one mission."""
MOST_PIXELS = 20_000_000
"""Pixels of one image."""
MOST_SAMPLE_CELLS = 20_000_000
"""Places at which the science-centric coverage could have been sampled."""


def require_mission(mission: MissionConfig, shared: SharedWorld | None = None) -> World:
    """Refuse a mission that cannot be held in memory or started, before its first stage, and return its world."""
    require_terrain(mission)
    world = (shared or SharedWorld(mission)).get()
    homes_of(world.area, Crew(mission.rover, mission.fleet))
    require_survey(mission, world.area.bounds)
    return world


def require_terrain(mission: MissionConfig) -> None:
    """Refuse simulated terrain with more cells than can be drawn."""
    if isinstance(mission.terrain, RandomTerrain):
        require_terrain_cells(mission.terrain.size_m, mission.terrain.size_m, mission.terrain.step_m)
    elif isinstance(mission.terrain, SampleTerrain):
        require_terrain_cells(600.0, 600.0, mission.terrain.step_m)
    elif mission.terrain.role == "prior":
        xmin, ymin, xmax, ymax = Dem.read(mission.path(mission.terrain.file), crs=mission.terrain.crs).bounds
        require_terrain_cells(xmax - xmin, ymax - ymin, mission.terrain.step_m)


def require_terrain_cells(
    width_m: float, height_m: float, step_m: float, most: int = MOST_TERRAIN_CELLS
) -> None:
    """Refuse a grid of terrain with more cells than allowed.

    `width_m`, `height_m`: sides of the site [m]. `step_m`: cell [m].

    >>> require_terrain_cells(600.0, 600.0, 1.0)
    >>> require_terrain_cells(600.0, 600.0, 0.001)
    Traceback (most recent call last):
    survey.core.errors.CapacityError: terrain of 600 × 600 m with step_m = 0.001 has 3.6e+11 cells, ...
    """
    n_cells = (width_m / step_m + 1.0) * (height_m / step_m + 1.0)
    if n_cells > most:
        smallest = smallest_step_m(width_m, height_m, most)
        raise CapacityError(
            f"terrain of {width_m:.6g} × {height_m:.6g} m with step_m = {step_m:g} has {n_cells:.3g} cells, and {most} "
            f"can be held; set step_m = {smallest:g} or more."
        )


def require_survey(mission: MissionConfig, bounds: Bounds) -> None:
    """Refuse prior, map, samples, landmarks, images or scoring grid beyond what can be computed.

    `bounds` (xmin, ymin, xmax, ymax): extent of the survey area [m].
    """
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    if not isinstance(mission.terrain, DemTerrain):
        require_cells(
            math.ceil(width / mission.satellite.cell_m + 1) * math.ceil(height / mission.satellite.cell_m + 1)
        )
    config = mission.reconstruction
    method = method_named(config.method)
    method.require_room(bounds, config.grid_step_m, config.configs_of(method), covered=True)
    sample_m = mission.score.sample_step_m
    n_places = width * height / sample_m**2
    _require("score.sample_step_m", sample_m, n_places, MOST_SAMPLE_CELLS, "possible samples", power=-0.5)
    if mission.fidelity == "vision":
        _require_fine_ground(mission.scenery.step_m, width, height)
    for name, count in (
        ("aids.stakes", mission.aids.stakes),
        ("instruments.stakes.count", mission.instruments.stakes.count),
    ):
        _require(name, count, count, MOST_STAKES, "stakes")
    length_m = _route_length_m(mission, width, height)
    if length_m is not None:
        _require_drive(mission, length_m)


def _require_fine_ground(step_m: float, width_m: float, height_m: float) -> None:
    """Refuse fine ground over an area with more cells than can be held."""
    n_cells = (width_m / step_m + 1.0) * (height_m / step_m + 1.0)
    if n_cells <= MOST_FINE_CELLS:
        return
    smallest = smallest_step_m(width_m, height_m, MOST_FINE_CELLS)
    largest = LARGEST_STEP_M
    remedy = f"set it to {smallest:g} or more" if smallest <= largest else "choose a smaller area"
    raise CapacityError(
        f"scenery.step_m = {step_m:g} gives {n_cells:.3g} cells of ground on {width_m:.6g} × {height_m:.6g} m, and "
        f"{MOST_FINE_CELLS} can be held; {remedy}."
    )


def _route_length_m(mission: MissionConfig, width_m: float, height_m: float) -> float | None:
    """Estimate the length of the route [m]; None where only planning can find it."""
    settings = mission.planner.model_dump()
    if settings.get("budget_m"):
        return float(settings["budget_m"])
    longer, shorter = max(width_m, height_m), min(width_m, height_m)
    if settings.get("spacing_m"):
        return longer * (shorter / float(settings["spacing_m"]) + 1.0)
    return longer * (float(settings["swaths"]) + 1.0) if settings.get("swaths") else None


def _require_drive(mission: MissionConfig, length_m: float) -> None:
    """Refuse more samples, landmarks or images on a drive of about this length than can be processed."""
    sensors, images, frame_hz = mission.sensors, mission.imaging, mission.instruments.frame_rate_hz
    if mission.fidelity == "ideal":
        n_samples = length_m / sensors.sample_step_m
        _require(
            "sensors.sample_step_m", sensors.sample_step_m, n_samples, MOST_SAMPLES, "samples", power=-1.0
        )
    elif mission.fidelity == "statistical":
        n_landmarks = length_m * sensors.landmarks_per_m
        _require("sensors.landmarks_per_m", sensors.landmarks_per_m, n_landmarks, MOST_LANDMARKS, "landmarks")
    else:
        _require_rates(mission, length_m / mission.rover.speed_m_s)
        n_frames = length_m / mission.rover.speed_m_s * frame_hz
        _require("instruments.frame_rate_hz", frame_hz, n_frames, MOST_FRAMES, "images")
        n_pixels = float(images.width) * images.height
        _require("imaging.width", images.width, n_pixels, MOST_PIXELS, "pixels in an image")


def _require_rates(mission: MissionConfig, seconds: float) -> None:
    """Refuse more steps of the physics, or more readings, on a drive of this time than can be processed."""
    rate_hz = float(mission.physics.rate_hz)
    _require("physics.rate_hz", rate_hz, rate_hz * seconds, MOST_PHYSICS_STEPS, "steps of the physics")
    for name, instrument in mission.instruments:
        if isinstance(instrument, InstrumentConfig):
            n_readings = instrument.rate_hz * seconds
            _require(f"instruments.{name}.rate_hz", instrument.rate_hz, n_readings, MOST_READINGS, "readings")


def _require(setting: str, value: float, n: float, most: int, what: str, *, power: float = 1.0) -> None:
    """Refuse a setting that gives too many; `n` grows with the value to 1 / `power`, or falls where it is negative."""
    if n <= most:
        return
    bound = value * (most / n) ** power
    side, bound = ("most", 0.99 * bound) if power > 0.0 else ("least", 1.01 * bound)
    raise CapacityError(
        f"{setting} = {value:g} gives about {n:.3g} {what}, and {most} can be processed; set it to at {side} {bound:.3g}."
    )
