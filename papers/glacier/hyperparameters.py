"""The glacier paper's grid search for α and γ (section II.D), redone on a site of its kind beside fitted values.

The paper gives a Gaussian process some of the terrain, tries many α and γ, and keeps those of the least error against
the real terrain: α = 10, γ = 315. In its Eq. (1) Γ holds 1/γ, so that √γ = 17.7 m is the length scale; read as
a length, γ is 315 m. Landmarks come from the statistical sensor.
"""

from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

import planners
import survey
from papers.glacier.surveys import SURVEY
from papers.outputs import write_figure
from sim.config.mission import MissionConfig
from sim.montecarlo.summary import SummaryRow, write_rows
from sim.simulate.statistical import simulate_statistical
from sim.world.site import World, build_world
from survey.core.arrays import FloatArray, Progress
from survey.core.config import validated
from survey.data.surface_points import SurfacePoints
from survey.figures.style import DEVIATION, ESTIMATE, FULL_IN, INK, styled
from survey.reconstruction import GaussianProcessConfig
from vision_slam import localize

SEED = 20_113
ALPHA, GAMMA = 10.0, 315.0
_STEP_M = 15.0
_MOST_POINTS = 1500
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
    every = -(-len(points) // _MOST_POINTS)
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
