"""Kernel and sine-curve experiment of the carving paper (Figs. 3 and 5)."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.carving.world import CRS, NOISE_M
from papers.outputs import write_csv, write_figure
from survey.core.arrays import FloatArray, Progress
from survey.core.streams import stream
from survey.data.surface_points import SurfacePoints
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, HALF_IN, INK, MUTED, ROVERS, styled
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.descent import wu_kernel
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

N_SAMPLES, FARTHEST_M, SENSOR_M = 400, 24.0, 3.0
N_EPOCHS, N_FIRST = 12, 2
ADDED = (17.3, -1.0)
"""Distance and height of the point that comes late [m], from a sensor above it: in the shadow of a crest."""


def figure_3(folder: Path, *, quick: bool, progress: Progress) -> None:  # noqa: ARG001
    """Draw Wu's kernel with length scales of 0.5, 1 and 2 (Fig. 3)."""
    x = np.linspace(-2.5, 2.5, 501)
    curves = {length: wu_kernel(np.abs(x), length) for length in (0.5, 1.0, 2.0)}
    write_csv(
        folder / "kernel.csv",
        ("distance_m", *(f"length_{length:g}_m" for length in curves)),
        zip(x[::10].tolist(), *(curve[::10].tolist() for curve in curves.values()), strict=True),
    )
    write_figure(folder / "kernel.png", _draw_kernel(x, curves))


def figure_5(folder: Path, *, quick: bool, progress: Progress) -> None:  # noqa: ARG001
    """Learn a sine curve: after two passes, after twelve, and with one more point (Fig. 5)."""
    points = seen_of_the_sine(0)
    x = np.linspace(0.0, FARTHEST_M, 601)
    model = SpaceCarvingKernel(SpaceCarvingConfig(n_epochs=N_EPOCHS, gate=False, prior_m=0.0)).begin(points)
    stages: dict[str, FloatArray] = {}
    for k, _ in enumerate(model.passes(), start=1):
        progress("passes", k, N_EPOCHS)
        if k in {N_FIRST, N_EPOCHS}:
            stages[f"after {k} passes"] = _three(model, x)
    hit, sensor = np.array([[ADDED[0], 0.0, ADDED[1]]]), np.array([[ADDED[0], 0.0, SENSOR_M]])
    late = SurfacePoints(hit, sigma_m=NOISE_M, origins=sensor, crs=CRS)
    stages["one point more"] = _three(model.update(late), x)
    write_csv(folder / "sine.csv", ("stage", *_MEASURES), (_row(name, x, s) for name, s in stages.items()))
    write_figure(folder / "sine.png", _draw_sine(points, x, stages))


def sine(x: FloatArray) -> FloatArray:
    """Return the curve's height [m]."""
    height: FloatArray = np.sin(x)
    return height


def seen_of_the_sine(seed: int) -> SurfacePoints:
    """Return what a sensor at the origin sees: fewer points farther away, none behind a crest."""
    rng = stream(seed, "carving", "sine")
    x = np.sort(np.minimum(rng.exponential(8.0, 4 * N_SAMPLES), FARTHEST_M))
    x = x[(x > 0.2) & (x < FARTHEST_M)]
    slope = (sine(x) - SENSOR_M) / x
    ground = np.linspace(0.05, FARTHEST_M, 4000)
    # A point is seen when no ground before it stands higher in the sensor's eye.
    highest = np.maximum.accumulate((sine(ground) - SENSOR_M) / ground)
    x = x[slope >= np.interp(x, ground, highest) - 1e-3]
    x = rng.permutation(x)[:N_SAMPLES]
    z = sine(x) + NOISE_M * rng.standard_normal(len(x))
    xyz = np.column_stack([x, np.zeros_like(x), z])
    return SurfacePoints(xyz, sigma_m=NOISE_M, origins=np.tile([0.0, 0.0, SENSOR_M], (len(x), 1)), crs=CRS)


def _three(model: SpaceCarvingKernel, x: FloatArray) -> FloatArray:
    """Return surface, lower and upper surface (3, N) along the line."""
    xy = np.column_stack([x, np.zeros_like(x)])
    return np.stack([model.predict(xy), *model.prior_surfaces(xy)])


_MEASURES = ("rmse_m", "within_bounds_and_3_sigma", "mean_width_m", "at_added_point_m")


def _row(name: str, x: FloatArray, stage: FloatArray) -> tuple[object, ...]:
    z = sine(x)
    within = (stage.min(axis=0) - 3.0 * NOISE_M <= z) & (z <= stage.max(axis=0) + 3.0 * NOISE_M)
    rmse = float(np.sqrt(np.mean((stage[0] - z) ** 2)))
    width = float(np.mean(stage[2] - stage[1]))
    return name, rmse, float(within.mean()), width, float(np.interp(ADDED[0], x, stage[0]))


@styled
def _draw_kernel(x: FloatArray, curves: dict[float, FloatArray]) -> Figure:
    figure = Figure(figsize=(HALF_IN, 2.8), layout="constrained")
    axes: Axes = figure.subplots()
    for colour, (length, curve) in zip(ROVERS, curves.items(), strict=False):
        axes.plot(x, curve, color=colour, label=f"σ = {length:g} m")
    axes.set(xlabel="distance [m]", ylabel="kernel", title="Wu φ₂,₁, divided by 4")
    axes.legend()
    return figure


@styled
def _draw_sine(points: SurfacePoints, x: FloatArray, stages: dict[str, FloatArray]) -> Figure:
    figure = Figure(figsize=(FULL_IN, 7.0), layout="constrained")
    all_axes = figure.subplots(4, 1, sharex=True, sharey=True)
    top = all_axes[0]
    for hit in points.xyz[::25]:
        top.plot([0.0, hit[0]], [SENSOR_M, hit[2]], color=MUTED, linewidth=0.4)
    top.plot(points.xyz[:, 0], points.z, ".", color=INK, markersize=2.5)
    top.set_title("points that the sensor sees, and some of its lines of sight")
    for axes, (name, (mean, lower, upper)) in zip(all_axes[1:], stages.items(), strict=True):
        axes.fill_between(
            x, mean, np.maximum(upper, mean), color=CLAIM, alpha=0.35, label="to the upper surface"
        )
        axes.fill_between(
            x, np.minimum(lower, mean), mean, color=ROVERS[3], alpha=0.3, label="to the lower surface"
        )
        axes.plot(x, sine(x), color=INK, linewidth=0.8, label="ground")
        axes.plot(x, mean, color=ESTIMATE, label="estimate")
        axes.set_title(name)
    all_axes[3].plot(*ADDED, "o", color=CLAIM, markersize=5)
    all_axes[1].legend(ncols=4, loc="lower left")
    for axes in all_axes:
        axes.set(ylabel="height [m]", ylim=(-5.5, 5.5))
    all_axes[3].set_xlabel("distance [m]")
    return figure
