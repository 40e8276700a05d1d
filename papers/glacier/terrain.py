"""The glacier paper's Figs. 5 to 8 and Tables I to III: terrain from one traverse, a steered path, coverage, classes.

The paper does not print its traverse; ours crosses a site of its kind once, from the south-west to the north-east.
The drawings of maps, errors and coverages stand first.
"""

import io
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

import planners
import survey
from planners.registry import steering_of
from sim.config.mission import AreaConfig, MissionConfig
from sim.config.world import RandomTerrain, SceneryConfig
from sim.montecarlo.results import SummaryRow, write_rows
from sim.simulate.simulation import simulate_statistical
from sim.simulate.steering import AttitudeErrors, drive_steered
from sim.simulate.vision import simulate_vision
from sim.world.site import World, build_world
from survey import Leg, Route, SurfacePoints
from survey.core import FloatArray, Progress, replacing, stream
from survey.figures.layout import add_colour_bar, map_figure
from survey.figures.map_layers import (
    draw_area,
    draw_raster,
    draw_shaded_elevation,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.maps import survey_map
from survey.figures.style import ERROR, ESTIMATE, FULL_IN, INK, MUTED, png_bytes, styled, symmetric_limits
from survey.reconstruction import GaussianProcessConfig, Reconstruction
from survey.scoring import Coverage, map_classes
from vision_slam import localize

SAMPLE_M = 50.0


@dataclass(frozen=True)
class Traverse:
    """Drive over the site and its landmarks."""

    world: World
    route: Route
    points: SurfacePoints


def map_error(result: Reconstruction, done: Traverse) -> FloatArray:
    """Return the error of a map (H, W) [m]."""
    mean = result.mean
    error: FloatArray = mean.elevation - done.world.terrain.at(mean.xy).reshape(mean.shape)
    return error


def convex_hull(points: SurfacePoints) -> shapely.Geometry:
    """Return the convex hull of points."""
    return shapely.convex_hull(shapely.multipoints(points.xy))


@styled
def draw_terrains(maps: dict[str, Reconstruction], done: Traverse) -> Figure:
    """Draw maps with the path and the landmarks' convex hull."""
    area = done.world.area
    drawing = map_figure(FULL_IN, area.bounds, n_maps=len(maps))
    inner = done.world.terrain.window(area.bounds)
    limits, exaggeration = elevation_limits(inner), relief_exaggeration(inner)
    for axes, (name, result) in zip(drawing.maps, maps.items(), strict=True):
        image = draw_shaded_elevation(axes, result.mean, limits, exaggeration=exaggeration)
        _draw_traverse(axes, done)
        axes.set_title(name)
    add_colour_bar(image, drawing, "Elevation [m]", extend="both")
    return drawing.figure


@styled
def draw_errors(maps: dict[str, Reconstruction], done: Traverse) -> Figure:
    """Draw the errors of maps."""
    area = done.world.area
    drawing = map_figure(FULL_IN, area.bounds, n_maps=len(maps))
    errors = [map_error(result, done) for result in maps.values()]
    limits = symmetric_limits(errors[-1])
    for axes, name, error in zip(drawing.maps, maps, errors, strict=True):
        image = draw_raster(axes, error, maps[name].mean, ERROR, limits)
        _draw_traverse(axes, done)
        axes.set_title(name)
    add_colour_bar(image, drawing, "Error [m]", extend="both")
    return drawing.figure


def _draw_traverse(axes: Axes, done: Traverse) -> None:
    """Draw the path as a solid line and the landmarks' convex hull as a dashed one, as the paper does."""
    draw_area(axes, done.world.area, veil=False)
    axes.plot(*done.route.path().T, color=INK, linewidth=1.3, zorder=5)
    axes.plot(
        *np.array(convex_hull(done.points).exterior.coords).T,
        color=INK,
        linestyle="--",
        linewidth=0.9,
        zorder=5,
    )


@styled
def draw_coverages(area: survey.SurveyArea, route: Route, coverage: Coverage) -> Figure:
    """Draw a route as the distance driven, and as samples with their distances to the centre."""
    figure = Figure(figsize=(FULL_IN, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    xmin, ymin, xmax, ymax = area.bounds
    for axes in (left, right):
        axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax), aspect="equal", xlabel="Easting [m]")
        axes.spines[:].set_visible(True)
    left.plot(*route.path().T, color=ESTIMATE, linewidth=2.0)
    left.set(ylabel="Northing [m]", title=f"Robot-centric: {route.length_m:,.0f} m driven")
    half = 0.5 * SAMPLE_M
    centres = np.arange(xmin + half, xmax, SAMPLE_M), np.arange(ymin + half, ymax, SAMPLE_M)
    possible = np.column_stack([axis.ravel() for axis in np.meshgrid(*centres)])
    right.plot(*possible.T, ".", color=MUTED, markersize=2)
    within = np.clip(route.sample(10.0).xy, [xmin, ymin], [xmax - 1e-6, ymax - 1e-6])
    samples = np.unique(np.floor((within - [xmin, ymin]) / SAMPLE_M), axis=0)
    for corner in samples * SAMPLE_M + [xmin, ymin]:
        right.add_patch(Rectangle(tuple(corner), SAMPLE_M, SAMPLE_M, color=ESTIMATE, alpha=0.35, linewidth=0))
    centre = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)])
    for corner in samples[::3] * SAMPLE_M + [xmin + half, ymin + half]:
        right.plot(*np.array([centre, corner]).T, color=INK, linewidth=0.4, alpha=0.5)
    right.plot(*centre, "+", color=INK, markersize=9)
    right.set_title(f"Science-centric: SCC {coverage.scc:.1%} of {SAMPLE_M:g} m cells")
    return figure


def write_quantized(path: Path, figure: Figure) -> None:
    """Write a map in 192 colours, which shading does not need more of: a fifth of the bytes."""
    image = Image.open(io.BytesIO(png_bytes(figure))).convert("RGB")
    with replacing(path) as draft:
        image.quantize(192, dither=Image.Dither.NONE).save(draft, "PNG", optimize=True)


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
    steering = steering_of(config)
    if steering is None:
        raise TypeError("the piecewise-continuous pattern is steered")
    sensed = [stream(mission.seed, "steering", "sensed")]
    errors = AttitudeErrors(mission.sensors, mission.rover.speed_m_s, sensed)
    rngs = [stream(SEED, "fig7")]
    driven = drive_steered(world.area, reference, steering, world.terrain, rngs=rngs, errors=errors)[0]
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
