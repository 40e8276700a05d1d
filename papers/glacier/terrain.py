"""The glacier paper's Figs. 5 to 8 and Tables I to III: terrain from one traverse, a steered path, coverage, classes.

The paper does not print its traverse; ours crosses a site of its kind once, from the south-west to the north-east.
"""

import tempfile
from pathlib import Path

import numpy as np
import shapely

import planners
import survey
from papers.glacier.terrain_figures import (
    SAMPLE_M,
    Traverse,
    convex_hull,
    draw_coverages,
    draw_errors,
    draw_terrains,
    map_error,
    write_quantized,
)
from sim.config.mission import AreaConfig, MissionConfig
from sim.config.scene import SceneryConfig
from sim.config.terrain import RandomTerrain
from sim.montecarlo.summary import SummaryRow, write_rows
from sim.simulate.sensed_attitude import sensed_attitude
from sim.simulate.statistical import simulate_statistical
from sim.simulate.vision import simulate_vision
from sim.world.site import build_world
from survey.core.arrays import Progress
from survey.core.streams import stream
from survey.data.legs import Leg
from survey.data.route import Route
from survey.figures.maps import survey_map
from survey.reconstruction import GaussianProcessConfig, Reconstruction
from survey.scoring import Coverage, map_classes
from vision_slam import localize

SEED = 20_112
PAPERS_SHARE = 0.258
_TRAVERSE_M = ((60.0, 90.0), (330.0, 170.0), (470.0, 400.0), (540.0, 550.0))
_STEP_M = 5.0


def glacier_fig5(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Map one traverse by a mesh, by a Gaussian process, and by one around the satellite's cells.

    In full the landmarks come from rendered images; `quick` draws them.
    """
    done = traverse("statistical" if quick else "vision")
    progress("maps", 1, 4)
    maps: dict[str, Reconstruction] = {}
    for index, name in enumerate(("Triangular mesh", "Gaussian process", "Gaussian process, satellite"), 2):
        maps[name] = _mapped(done, name)
        progress("maps", index, 4)
    write_rows(folder / "reconstructions.csv", [_judged(name, result, done) for name, result in maps.items()])
    write_quantized(folder / "reconstructions.png", draw_terrains(maps, done))
    write_quantized(folder / "errors.png", draw_errors(maps, done))


def glacier_fig6(folder: Path, *, quick: bool, progress: Progress) -> None:  # noqa: ARG001
    """Draw the real terrain of Fig. 5."""
    world = build_world(_mission("statistical"))
    write_quantized(folder / "terrain.png", survey_map(world.terrain, area=world.area))
    progress("maps", 1, 1)


def glacier_fig7(folder: Path, *, quick: bool, progress: Progress) -> None:  # noqa: ARG001
    """Draw a piecewise-continuous path over terrain whose trends are slow, steered by sensed roll and pitch."""
    mission = _mission("statistical")
    world = build_world(mission)
    config = planners.PiecewiseContinuousConfig(swaths=2)
    reference = planners.plan(world.area, world.prior, config)
    steering = planners.steering_of(config)
    if steering is None:
        raise TypeError("the piecewise-continuous pattern is steered")
    sense = sensed_attitude(planners.attitude_sensor(world.terrain), mission)
    driven = planners.rollout(world.area, reference, steering, sense, [stream(SEED, "fig7")])[0]
    write_quantized(
        folder / "piecewise_continuous_path.png", survey_map(world.terrain, area=world.area, route=driven)
    )
    progress("maps", 1, 1)


def glacier_fig8(folder: Path, *, quick: bool, progress: Progress) -> None:  # noqa: ARG001
    """Draw robot-centric and science-centric coverage: distance driven, and samples."""
    area = survey.SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    route = planners.plan(area, None, planners.LawnmowerConfig(swaths=4))
    coverage = Coverage.of(route, area, sample_step_m=SAMPLE_M)
    row: SummaryRow = {
        "swaths": 4,
        "driven_m": route.length_m,
        "cells_share": coverage.cells_share,
        "scc": coverage.scc,
        "alpha": coverage.alpha,
        "beta": coverage.beta,
    }
    write_rows(folder / "coverage.csv", [row])
    write_quantized(folder / "coverage.png", draw_coverages(area, route, coverage))
    progress("figures", 1, 1)


def glacier_tables(folder: Path, *, quick: bool, progress: Progress) -> None:  # noqa: ARG001
    """Write Tables I to III: the limits of the map classes."""
    rows: list[SummaryRow] = [
        {"class": one.map_class, "contour_interval_m": one.interval_m, "limiting_rmse_m": one.limit_m}
        for one in map_classes()
    ]
    write_rows(folder / "map_classes.csv", rows)
    progress("tables", 1, 1)


def traverse(fidelity: str) -> Traverse:
    """Drive the traverse and localize its landmarks."""
    mission = _mission(fidelity)
    world = build_world(mission)
    corner = np.array(world.area.bounds[:2])
    legs = (Leg("swath", np.array(_TRAVERSE_M) + corner),)
    route = Route(legs, world.area.crs, "lawnmower")
    if fidelity == "statistical":
        recording = simulate_statistical(world.terrain, route, mission)[0]
        return Traverse(world, route, localize(recording, mission.assumed).points)
    with tempfile.TemporaryDirectory(prefix="firnline-") as place:
        recording = simulate_vision(world.terrain, route, mission, Path(place) / "recording").recording
        return Traverse(world, route, localize(recording, mission.assumed).points)


def _mission(fidelity: str) -> MissionConfig:
    x, y = 526_050.0, 6_478_050.0
    return MissionConfig.model_validate(
        {
            "schema_version": 1,
            "name": "traverse",
            "seed": SEED,
            "fidelity": fidelity,
            "terrain": RandomTerrain(source="random", family="slope_and_waves", size_m=700.0, relief_m=29.0),
            "area": AreaConfig(bounds_m=(x, y, x + 600.0, y + 600.0)),
            "planner": planners.LawnmowerConfig(swaths=1),
            "scenery": SceneryConfig(crevasses_per_ha=0.0, channels_per_ha=0.0, dirt_cones_per_ha=0.0),
        }
    )


def _mapped(done: Traverse, name: str) -> Reconstruction:
    area = done.world.area
    grid = survey.Grid.over(area.bounds, _STEP_M, area.crs)
    if name == "Triangular mesh":
        return survey.reconstruct(done.points, grid, method="tin")
    if name == "Gaussian process":
        return survey.reconstruct(done.points, grid, config=GaussianProcessConfig(mean="constant"))
    return survey.reconstruct(done.points, grid, prior=done.world.prior)


def _judged(name: str, result: Reconstruction, done: Traverse) -> SummaryRow:
    error = map_error(result, done)
    hull = convex_hull(done.points)
    inside = shapely.contains_xy(hull, *result.mean.xy.T).reshape(error.shape)
    return {
        "map": name,
        "landmarks": len(done.points),
        "share_mapped": float(np.isfinite(error).mean()),
        "papers_share_mapped": PAPERS_SHARE if name == "Triangular mesh" else 1.0,
        "rmse_in_hull_m": float(np.sqrt(np.nanmean(error[inside] ** 2))),
        "rmse_m": float(np.sqrt(np.nanmean(error**2))),
        "worst_m": float(np.nanmax(np.abs(error))),
    }
