"""The glacier paper's Figs. 12 and 13: both surveys driven in images, their landmarks, and their maps.

Both patterns survey five sites; the figures show the site whose RMSE, averaged over the patterns, is the median, and the
tables list all five. Missions are run as ``firnline run`` would, into the folder of runs beside the figures; finished
stages are read, unfinished runs are continued.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import survey
from papers.outputs import write_figure
from sim.config.mission import MissionConfig
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.montecarlo.summary import SummaryRow, write_rows
from survey.core.arrays import FloatArray, Progress
from survey.core.config import validated
from survey.core.documents import read_json
from survey.core.runs.store import RunFolder
from survey.data.truth import Truth
from survey.figures.errors import height_error
from survey.figures.layout import MapFigure, add_colour_bar, grouped, map_figure
from survey.figures.map_layers import (
    draw_area,
    draw_raster,
    draw_terrain,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.style import ERROR, ESTIMATE, FULL_IN, INK, styled, symmetric_limits

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
        image = draw_terrain(axes, one.map.mean, limits, exaggeration=relief_exaggeration(one.map.mean))
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
