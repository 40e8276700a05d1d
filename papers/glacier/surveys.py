"""The glacier paper's Figs. 12 and 13, surveys driven in images, and its grid search for α and γ.

Both patterns survey five sites; the figures show the site whose RMSE, averaged over the patterns, is the median, and the
tables list all five. Missions are run as ``firnline run`` would, into the folder of runs beside the figures; finished
stages are read, unfinished runs are continued.

For α and γ (section II.D) the paper gives a Gaussian process some of the terrain, tries many values, and keeps those of
the least error against the real terrain: α = 10, γ = 315. In its Eq. (1) Γ holds 1/γ, so that √γ = 17.7 m is the length
scale; read as a length, γ is 315 m. Landmarks come from the statistical sensor. The grid search is done on a site of the
paper's kind, beside fitted values.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

import planners
import survey
from papers.outputs import write_figure
from sim.config.mission import MissionConfig
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.montecarlo.results import SummaryRow, write_rows
from sim.simulate.simulation import simulate_statistical
from sim.world.site import World, build_world
from survey import SurfacePoints, Truth
from survey.core import FloatArray, Progress, read_json, validated
from survey.core.run_folder import RunFolder
from survey.figures.errors import height_error
from survey.figures.layout import MapFigure, add_colour_bar, grouped, map_figure
from survey.figures.map_layers import (
    draw_area,
    draw_raster,
    draw_shaded_elevation,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.style import DEVIATION, ERROR, ESTIMATE, FULL_IN, INK, styled, symmetric_limits
from survey.reconstruction import GaussianProcessConfig
from vision_slam import localize

SEEDS = (71, 72, 73, 74, 75)
"""Seeds of the sites; nothing was chosen on them."""
PAPERS_RMSE_M = {"lawnmower": 0.2827, "piecewise-continuous": 0.3323}
SWATHS = {"lawnmower": 4, "piecewise-continuous": 2}
_MOST_POINTS = 15_000
SURVEY: dict[str, Any] = {
    "schema_version": 1,
    "name": "mendenhall-like",
    "fidelity": "vision",
    "terrain": {
        "source": "random",
        "family": "squared-exponential",
        "length_scale_m": 220.0,
        "size_m": 700.0,
        "relief_m": 29.0,
    },
    "area": {"bounds_m": [526050.0, 6478050.0, 526650.0, 6478650.0]},
    "rover": {"mass_kg": 18.0, "idle_w": 20.0},
    "physics": {"steer_by": "estimate"},
    "scenery": {"crevasses_per_ha": 0.0, "channels_per_ha": 0.0, "dirt_cones_per_ha": 0.0},
    "instruments": {"gps": {"profile": "gauss-markov-60"}, "stakes": {"count": 4}},
    "localization": {
        "gps_bias_sigma_m": 3.0,
        "gps_white_sigma_m": 1.0,
        "gps_correlation_time_s": 300.0,
    },
}
"""``examples/mendenhall_like.toml`` but for its planner and seed."""
_QUICK: dict[str, Any] = {
    "name": "mendenhall-like-quick",
    "terrain": {**SURVEY["terrain"], "size_m": 80.0, "relief_m": 4.0, "length_scale_m": 40.0},
    "area": {"bounds_m": [526025.0, 6478025.0, 526055.0, 6478055.0]},
    "imaging": {"width": 320, "height": 240},
    "satellite": {"cell_m": 10.0},
}


@dataclass(frozen=True)
class MissionResult:
    """Outputs of a mission."""

    planner: str
    seed: int
    area: survey.SurveyArea
    real: Truth
    points: survey.SurfacePoints
    map: survey.Reconstruction
    score: dict[str, Any]

    @property
    def rmse_m(self) -> float:
        """Root mean square error of the map [m]."""
        return float(self.score["elevation"]["rmse_m"])


def mission_of(planner: str, seed: int, *, quick: bool) -> MissionConfig:
    """Return the survey of a site, with as many swaths as the paper found to suffice; `quick` is a small one."""
    given = SURVEY | {"seed": seed, "planner": {"pattern": planner, "swaths": SWATHS[planner]}}
    return validated(MissionConfig, given | (_QUICK if quick else {}), "the survey")


def glacier_fig12(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Draw the driven paths and where the landmarks lie."""
    done = _surveyed(folder, quick=quick, progress=progress)
    shown = at_median_site(done)
    write_rows(folder / "surveys.csv", [_row(one, shown) for one in done])
    write_figure(folder / "paths_and_landmarks.png", paths_and_landmarks(shown))


def glacier_fig13(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Draw the maps and their errors."""
    done = _surveyed(folder, quick=quick, progress=progress)
    shown = at_median_site(done)
    write_rows(folder / "maps.csv", [_row(one, shown) for one in done])
    write_figure(folder / "maps.png", maps(shown))
    write_figure(folder / "errors.png", errors(shown))


def at_median_site(done: list[MissionResult]) -> list[MissionResult]:
    """Return the surveys of the site whose RMSE, averaged over the patterns, is the median of all sites."""
    sites = sorted({one.seed for one in done})
    mean_m = {seed: np.mean([one.rmse_m for one in done if one.seed == seed]) for seed in sites}
    median = sorted(sites, key=lambda seed: float(mean_m[seed]))[len(sites) // 2]
    return [one for one in done if one.seed == median]


@styled
def paths_and_landmarks(done: list[MissionResult]) -> Figure:
    """Draw the paths over the landmarks that the maps were made of, as the paper's Fig. 12."""
    drawing = _side_by_side(done)
    drawing.bar.set_visible(False)
    for axes, one in zip(drawing.maps, done, strict=True):
        every = -(-len(one.points) // _MOST_POINTS)
        axes.plot(*one.points.xy[::every].T, ".", color=ESTIMATE, markersize=1.2, alpha=0.6, zorder=2)
        _draw_path(axes, one)
        axes.set_title(f"{_pattern(one)}: {grouped(len(one.points))} landmarks")
    return drawing.figure


@styled
def maps(done: list[MissionResult]) -> Figure:
    """Draw the reconstructions in one scale of colours, as the paper's Fig. 13 a and c."""
    drawing = _side_by_side(done)
    limits = elevation_limits(*(one.map.mean for one in done))
    for axes, one in zip(drawing.maps, done, strict=True):
        image = draw_shaded_elevation(
            axes, one.map.mean, limits, exaggeration=relief_exaggeration(one.map.mean)
        )
        _draw_path(axes, one)
        axes.set_title(f"{_pattern(one)}, {SWATHS[one.planner]} swaths")
    add_colour_bar(image, drawing, "Elevation [m]")
    return drawing.figure


@styled
def errors(done: list[MissionResult]) -> Figure:
    """Draw the errors in one scale of colours, as the paper's Fig. 13 b and d."""
    drawing = _side_by_side(done)
    wrong = [height_error(one.map, one.real.dem, one.area) for one in done]
    limits = symmetric_limits(np.concatenate([error.ravel() for error in wrong]))
    for axes, one, error in zip(drawing.maps, done, wrong, strict=True):
        image = draw_raster(axes, error, one.map.mean, ERROR, limits)
        _draw_path(axes, one)
        axes.set_title(f"{_pattern(one)}: RMSE {one.score['elevation']['rmse_m']:.3f} m")
    add_colour_bar(image, drawing, "Error [m]", extend="both")
    return drawing.figure


def _side_by_side(done: list[MissionResult]) -> MapFigure:
    return map_figure(FULL_IN, done[0].area.bounds, n_maps=len(done))


def _draw_path(axes: Axes, one: MissionResult) -> None:
    draw_area(axes, one.area, veil=False)
    axes.plot(*one.real.trajectory.position[:, :2].T, color=INK, linewidth=1.1, zorder=5)


def _pattern(one: MissionResult) -> str:
    return one.planner.replace("-", " ").capitalize()


def _row(one: MissionResult, shown: list[MissionResult]) -> SummaryRow:
    path: FloatArray = one.real.trajectory.position[:, :2]
    return {
        "site": one.seed,
        "shown": one.seed == shown[0].seed,
        "planner": one.planner,
        "swaths": SWATHS[one.planner],
        "driven_m": float(np.hypot(*np.diff(path, axis=0).T).sum()),
        "landmarks": len(one.points),
        "rmse_m": one.rmse_m,
        "papers_rmse_m": PAPERS_RMSE_M[one.planner],
    }


def _surveyed(folder: Path, *, quick: bool, progress: Progress) -> list[MissionResult]:
    """Run both missions at every site, or read their finished stages; `quick` at the first site."""
    pairs = [(seed, planner) for seed in (SEEDS[:1] if quick else SEEDS) for planner in SWATHS]
    done = []
    for index, (seed, planner) in enumerate(pairs, start=1):
        mission = mission_of(planner, seed, quick=quick)
        run = open_run(mission, folder.parent / "runs")
        run_mission(mission, run, until="score")
        done.append(_read(planner, seed, run))
        progress("surveys", index, len(pairs))
    return done


def _read(planner: str, seed: int, run: RunFolder) -> MissionResult:
    return MissionResult(
        planner,
        seed,
        survey.SurveyArea.read(run.folder("plan") / "area.gpkg"),
        Truth.read(run.folder("simulate") / "truth"),
        survey.SurfacePoints.read(run.folder("localize") / "surface_points.gpkg"),
        survey.Reconstruction.read(run.folder("reconstruct")),
        read_json(run.folder("score") / "score.json", "the score"),
    )


SEED = 20_113
ALPHA, GAMMA = 10.0, 315.0
_STEP_M = 15.0
_MOST_GIVEN_POINTS = 1500
_TICKS_M = (0.2, 0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0)
_NUGGET_M = 0.15
"""Relief of snow too fine to be mapped, which the paper's noise of a landmark stands for [m]."""


def glacier_hyperparameters(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Try variances and length scales, and hold the paper's and the fitted ones beside the best."""
    world, points = _site(quick=quick)
    n = 5 if quick else 9
    variances, lengths_m = np.geomspace(0.1, 1e5, n), np.geomspace(8.0, 500.0, n + 2)
    errors = np.empty((len(variances), len(lengths_m)))
    for index, variance in enumerate(variances.tolist()):
        errors[index] = [_rmse_m(world, points, _given(variance, length)) for length in lengths_m.tolist()]
        progress("variances", index + 1, len(variances))
    best = np.unravel_index(np.argmin(errors), errors.shape)
    marked = {
        "least error of the grid": (float(variances[best[0]]), float(lengths_m[best[1]])),
        "paper, γ = 315 m² (17.7 m)": (ALPHA, float(np.sqrt(GAMMA))),
        "paper, γ = 315 m": (ALPHA, GAMMA),
        "fitted by likelihood": _fitted(world, points),
    }
    rows: list[SummaryRow] = [
        {
            "what": name,
            "variance_m2": variance,
            "length_scale_m": length,
            "rmse_m": _rmse_m(world, points, _given(variance, length)),
        }
        for name, (variance, length) in marked.items()
    ]
    write_rows(folder / "hyperparameters.csv", rows)
    write_figure(folder / "hyperparameters.png", _drawn(variances, lengths_m, errors, marked))


def _site(*, quick: bool) -> tuple[World, SurfacePoints]:
    """Survey a site of the kind of Figs. 12 and 13 by four swaths."""
    pattern = {"pattern": "lawnmower", "swaths": 4}
    given = SURVEY | {"seed": SEED, "fidelity": "statistical", "planner": pattern}
    mission = validated(
        MissionConfig, given | {"sensors": {"landmarks_per_m": 0.5 if quick else 2.0}}, "the study"
    )
    world = build_world(mission)
    route = planners.plan(world.area, world.prior, mission.planner, rover=mission.rover)
    points = localize(simulate_statistical(world.terrain, route, mission)[0], mission.assumed).points
    points = points.select(world.area.contains(points.xy))
    # Densely solved, so that no pair is out of reach; the paper gives some of its landmarks too.
    every = -(-len(points) // _MOST_GIVEN_POINTS)
    return world, points.select(np.arange(len(points)) % every == 0)


def _given(variance: float, length_m: float) -> GaussianProcessConfig:
    return GaussianProcessConfig(
        fit=False,
        family="squared-exponential",
        variance_m2=variance,
        length_scale_m=length_m,
        nugget_m=_NUGGET_M,
    )


def _fitted(world: World, points: SurfacePoints) -> tuple[float, float]:
    learned = GaussianProcessConfig(family="squared-exponential")
    found = _mapped(world, points, learned).hyperparameters
    return float(found["variance_m2"]), float(found["length_scale_m"])


def _mapped(world: World, points: SurfacePoints, config: GaussianProcessConfig) -> survey.Reconstruction:
    grid = survey.Grid.over(world.area.bounds, _STEP_M, world.area.crs)
    return survey.reconstruct(points, grid, method="dense", config=config)


def _rmse_m(world: World, points: SurfacePoints, config: GaussianProcessConfig) -> float:
    mean = _mapped(world, points, config).mean
    error = mean.elevation - world.terrain.at(mean.xy).reshape(mean.shape)
    return float(np.sqrt(np.mean(error**2)))


@styled
def _drawn(
    variances: FloatArray, lengths_m: FloatArray, errors: FloatArray, marked: dict[str, tuple[float, float]]
) -> Figure:
    """Draw the error over the grid, with the chosen pairs on it."""
    figure = Figure(figsize=(FULL_IN, 4.6), layout="constrained")
    axes = figure.subplots()
    limits = LogNorm(float(errors.min()), float(min(errors.max(), 30.0 * errors.min())))
    shown = axes.pcolormesh(lengths_m, variances, errors, norm=limits, cmap=DEVIATION, shading="gouraud")
    for marker, (name, (variance, length)) in zip("*sDo", marked.items(), strict=True):
        axes.plot(
            length,
            variance,
            marker,
            color=ESTIMATE,
            markeredgecolor=INK,
            markersize=10,
            linestyle="",
            label=name,
        )
    axes.set(xscale="log", yscale="log", xlabel="Length scale [m]", ylabel="Variance α [m²]")
    axes.set_title("Error of the map against the terrain")
    bar = figure.colorbar(shown, label="RMSE [m]", extend="max", ticks=_TICKS_M, format="%g")
    bar.minorticks_off()
    figure.legend(loc="outside lower center", ncols=len(marked))
    return figure
