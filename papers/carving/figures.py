"""Figures of the carving paper: kernel and sine curve (3, 5), and maps of terrain (7 to 10 and 13).

The maps show surfaces and bounds, cross-sections, contributions of the kernels, and a drive downhill.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from papers.carving.comparison import LiteralCarving
from papers.carving.world import CRS, HALF_M, N_TRAIN, NOISE_M, SENSOR_HEIGHT_M, CarvingWorld, ScanTrial
from papers.emap.world import RasterHeights
from papers.outputs import write_csv, write_figure
from survey import Grid, SurfacePoints
from survey.core import FloatArray, Progress, stream
from survey.figures.style import (
    CLAIM,
    DENSITY,
    ELEVATION,
    ERROR,
    ESTIMATE,
    FULL_IN,
    HALF_IN,
    INK,
    MUTED,
    PRIOR,
    ROVERS,
    styled,
)
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


SEED = 0
SLOPE_DEG = 5.0


def figure_7(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Map estimate, lower and upper surface of the piles, and the points (Fig. 7)."""
    trial, model = _learned(quick, progress)
    lower, upper = (z.reshape(GRID.shape) for z in model.prior_surfaces(GRID.xy))
    mean, ground = (z.reshape(GRID.shape) for z in (model.predict(GRID.xy), trial.world.heights(GRID.xy)))
    within = (np.minimum(mean, lower) <= ground) & (ground <= np.maximum(mean, upper))
    rows = [
        ("bases made by points", model.n_bases()[0]),
        ("bases made by lines of sight", model.n_bases()[1]),
        ("share of the ground between the surfaces", float(within.mean())),
        ("mean distance of the surfaces [m]", float(np.mean(upper - lower))),
        ("RMSE of the estimate [m]", float(np.sqrt(np.mean((mean - ground) ** 2)))),
    ]
    write_csv(folder / "surfaces.csv", ("what", "value"), rows)
    maps = {"ground": ground, "estimate": mean, "lower surface": lower, "upper surface": upper}
    write_figure(folder / "surfaces.png", draw_surfaces(maps, trial.train.xy))


def figure_8(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Cut the three surfaces along four lines (Fig. 8)."""
    trial, model = _learned(quick, progress)
    along = np.linspace(-HALF_M, HALF_M, 601)
    cuts = {name: _cut(trial, model, name, along) for name in SECTIONS}
    rows = [
        (name, float(np.sqrt(np.mean((c[1] - c[0]) ** 2))), float(np.mean(c[3] - c[2])))
        for name, c in cuts.items()
    ]
    write_csv(folder / "sections.csv", ("section", "rmse_m", "mean_width_m"), rows)
    write_figure(folder / "sections.png", draw_sections(trial, along, cuts))


def figure_9(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Show where the cross-sections lie among the points (Fig. 9)."""
    trial = _trial(quick)
    progress("scans", 1, 1)
    rows = [(name, axis, at) for name, (axis, at) in SECTIONS.items()]
    write_csv(folder / "sections.csv", ("section", "stays_at", "at_m"), rows)
    write_figure(folder / "sections.png", draw_places(trial))


def figure_10(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Map what lines of sight and what points contributed, in the kernels and in Algorithm 1 as printed (Fig. 10)."""
    trial, model = _learned(quick, progress)
    cells = Grid((-HALF_M + 0.25, -HALF_M + 0.25, HALF_M - 0.25, HALF_M - 0.25), 0.5, CRS)
    printed = LiteralCarving(SpaceCarvingConfig(bounds=False)).fit(trial.train).contributions(cells)
    ours = model.contributions(cells)
    edges = np.linspace(-HALF_M, HALF_M, 61)
    counts = np.histogram2d(trial.train.xyz[:, 1], trial.train.xyz[:, 0], [edges, edges])[0][::-1]
    rows = [
        (name, float(total.sum()), float(np.mean(total > 0.0)), _share_of_half(total))
        for name, total in zip(
            ("lines of sight", "points", "lines of sight, Algorithm 1", "points, Algorithm 1", "hits"),
            (*ours, *printed, counts),
            strict=True,
        )
    ]
    heading = ("what", "sum", "share_of_cells_above_0", "share_of_cells_with_half_of_it")
    write_csv(folder / "contributions.csv", heading, rows)
    write_figure(folder / "contributions.png", draw_contributions(ours, printed, counts))


def figure_13(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Look down a slope of 5° with a bank beside it, with and without lines of sight (Fig. 13)."""
    world = downhill_drive()
    points = world.scan(((-HALF_M + 2.0, 0.0),), stream(SEED, "carving", "downhill drive"))
    n = min(2000 if quick else N_TRAIN, len(points))
    rank = stream(SEED, "carving", "downhill drive", "deal").permutation(len(points))
    train = points.select(rank < n)
    sensor_m = float(world.sensor((-HALF_M + 2.0, 0.0))[2])
    maps: dict[str, FloatArray] = {"ground": world.heights(GRID.xy)}
    for k, (name, carve) in enumerate((("points alone", False), ("and lines of sight", True)), start=1):
        config = SpaceCarvingConfig(
            bounds=False, carve=carve, first_length_m=2.0, prior_m=sensor_m - SENSOR_HEIGHT_M
        )
        maps[name] = SpaceCarvingKernel(config).fit(train).predict(GRID.xy)
        progress("maps", k, 2)
    lane = np.abs(GRID.xy[:, 1]) < 3.0
    rows = [
        (name, *(float(np.sqrt(np.mean((z - maps["ground"])[where] ** 2))) for where in (lane, ~lane)))
        for name, z in list(maps.items())[1:]
    ]
    write_csv(folder / "downhill.csv", ("method", "rmse_of_the_lane_m", "rmse_beside_it_m"), rows)
    write_figure(folder / "downhill.png", draw_downhill(maps, train.xyz))


def downhill_drive() -> CarvingWorld:
    """Return a smooth lane that falls by 5° towards the east, level before it, with a bank on its north side."""
    side, step_m = HALF_M + 3.0, 0.1
    x = np.arange(-side, side + step_m / 2, step_m)
    east, north = np.meshgrid(x, x)
    lane = -np.tan(np.radians(SLOPE_DEG)) * np.maximum(east + HALF_M - 4.0, 0.0)
    bank = 1.5 / (1.0 + np.exp(-(north - 5.0) / 0.5))
    ripples = 0.03 * np.sin(1.3 * east) * np.cos(1.1 * north)
    return CarvingWorld("downhill drive", RasterHeights(lane + bank + ripples, step_m, -side, -side))


def _trial(quick: bool) -> ScanTrial:
    return ScanTrial.new("piles", SEED, n_train=2000 if quick else N_TRAIN)


def _learned(quick: bool, progress: Progress) -> tuple[ScanTrial, SpaceCarvingKernel]:
    """Return the piles and the three surfaces that were learned of them."""
    trial = _trial(quick)
    model = SpaceCarvingKernel().begin(trial.train)
    for k, _ in enumerate(model.passes(), start=1):
        progress("passes", k, model.config.n_epochs)
    return trial, model


def _cut(trial: ScanTrial, model: SpaceCarvingKernel, name: str, along: FloatArray) -> FloatArray:
    """Return ground, estimate, lower and upper surface (4, N) along a section."""
    xy = section_line(name, along)
    return np.stack([trial.world.heights(xy), model.predict(xy), *model.prior_surfaces(xy)])


def _share_of_half(total: FloatArray) -> float:
    """Return the share of cells that hold half of the sum: small where few cells hold most of it."""
    falling = np.cumsum(np.sort(total.ravel())[::-1])
    return float(np.searchsorted(falling, 0.5 * falling[-1]) + 1) / total.size


GRID = Grid((-HALF_M, -HALF_M, HALF_M, HALF_M), 0.25, CRS)
EXTENT = (-HALF_M, HALF_M, -HALF_M, HALF_M)
SECTIONS = {"A": ("north", 0.0), "B": ("north", -8.0), "C": ("east", 0.0), "D": ("east", 9.0)}
"""Four cross-sections: the axis along which each stays, and where [m]."""


def section_line(name: str, along: FloatArray) -> FloatArray:
    """Return the places (N, 2) of a cross-section at distances along it [m]."""
    axis, at = SECTIONS[name]
    still = np.full_like(along, at)
    return np.column_stack([along, still] if axis == "north" else [still, along])


@styled
def draw_surfaces(maps: dict[str, FloatArray], xy: FloatArray) -> Figure:
    """Draw ground, estimate and both surfaces, the points, and the distance between the surfaces."""
    figure = Figure(figsize=(FULL_IN, 6.0), layout="constrained")
    all_axes = figure.subplots(2, 3, sharex=True, sharey=True)
    places = (all_axes[0, 0], all_axes[0, 1], all_axes[1, 0], all_axes[1, 1])
    for axes, (name, z) in zip(places, maps.items(), strict=True):
        image = axes.imshow(z, extent=EXTENT, cmap=ELEVATION, vmin=-2.0, vmax=2.5)
        axes.set_title(name)
    all_axes[0, 2].plot(*xy.T, ",", color=INK)
    all_axes[0, 2].set(title="points", aspect="equal")
    width = all_axes[1, 2].imshow(
        maps["upper surface"] - maps["lower surface"], extent=EXTENT, cmap=DENSITY, vmin=0.0, vmax=6.0
    )
    all_axes[1, 2].set_title("upper minus lower")
    for axes in all_axes[1]:
        axes.set_xlabel("east [m]")
    for axes in all_axes[:, 0]:
        axes.set_ylabel("north [m]")
    figure.colorbar(image, ax=all_axes[:, :2], label="height [m]", shrink=0.7, extend="both")
    figure.colorbar(width, ax=all_axes[1, 2], label="distance [m]", shrink=0.8, extend="max")
    return figure


@styled
def draw_sections(trial: ScanTrial, along: FloatArray, cuts: dict[str, FloatArray]) -> Figure:
    """Draw the surfaces along the four cross-sections."""
    figure = Figure(figsize=(FULL_IN, 7.2), layout="constrained")
    all_axes = figure.subplots(len(cuts), 1, sharex=True, sharey=True)
    for axes, (name, (ground, mean, lower, upper)) in zip(all_axes, cuts.items(), strict=True):
        axes.fill_between(
            along, mean, np.maximum(upper, mean), color=CLAIM, alpha=0.35, label="to the upper surface"
        )
        axes.fill_between(
            along, np.minimum(lower, mean), mean, color=ROVERS[3], alpha=0.3, label="to the lower surface"
        )
        axes.plot(along, ground, color=INK, linewidth=0.9, label="ground")
        axes.plot(along, mean, color=ESTIMATE, label="estimate")
        axis, at = SECTIONS[name]
        stays, runs = (1, 0) if axis == "north" else (0, 1)
        near = np.abs(trial.train.xyz[:, stays] - at) < 0.1
        axes.plot(
            trial.train.xyz[near, runs],
            trial.train.z[near],
            ".",
            color=INK,
            markersize=2.5,
            label="points within 0.1 m",
        )
        axes.set(ylim=(-4.5, 5.5), ylabel="height [m]")
        axes.set_title(f"{name}: {axis} {at:+g} m")
    all_axes[0].legend(ncols=5, loc="upper center")
    all_axes[-1].set_xlabel("along the section [m]")
    return figure


@styled
def draw_places(trial: ScanTrial) -> Figure:
    """Draw the points and where the cross-sections are."""
    figure = Figure(figsize=(FULL_IN * 0.6, 5.0), layout="constrained")
    axes: Axes = figure.subplots()
    axes.plot(*trial.train.xy.T, ".", color=PRIOR, markersize=1.0)
    for colour, (name, (axis, _)) in zip(ROVERS, SECTIONS.items(), strict=False):
        ends = section_line(name, np.array([-HALF_M, HALF_M]))
        axes.plot(*ends.T, color=colour)
        east, north = ends[1] + (0.4, 0.0) if axis == "north" else ends[1] + (0.0, 0.5)
        axes.text(east, north, name, color=colour, weight="bold", ha="center", va="center", clip_on=False)
    axes.set(aspect="equal", xlabel="east [m]", ylabel="north [m]", xlim=(-15, 15.8), ylim=(-15, 15.8))
    axes.set_title("Where the sections lie", pad=12)
    return figure


@styled
def draw_contributions(
    ours: tuple[FloatArray, FloatArray], printed: tuple[FloatArray, FloatArray], counts: FloatArray
) -> Figure:
    """Draw what lines of sight and points contribute to both estimates, and the hits per cell."""
    figure = Figure(figsize=(FULL_IN, 5.2), layout="constrained")
    all_axes = figure.subplots(2, 3, sharex=True, sharey=True)
    norm = LogNorm(0.01, 30.0)
    for row, (name, totals) in zip(all_axes, (("kernels", ours), ("Algorithm 1", printed)), strict=True):
        for axes, title, total in zip(row, ("lines of sight", "points"), totals, strict=False):
            image = axes.imshow(np.maximum(total, 1e-6), extent=EXTENT, cmap=DENSITY, norm=norm)
            axes.set_title(f"{name}: {title}")
        row[0].set_ylabel("north [m]")
    figure.colorbar(
        image, ax=all_axes[:, :2], label="sum of |α| in 0.5 m cells [m]", shrink=0.7, extend="both"
    )
    hits = all_axes[0, 2].imshow(
        np.maximum(counts, 1e-6), extent=EXTENT, cmap=DENSITY, norm=LogNorm(0.8, 100.0)
    )
    all_axes[0, 2].set_title("hits")
    figure.colorbar(hits, ax=all_axes[0, 2], label="points in 0.5 m cells", shrink=0.8)
    all_axes[1, 2].axis("off")
    for axes in all_axes[1, :2]:
        axes.set_xlabel("east [m]")
    return figure


@styled
def draw_downhill(maps: dict[str, FloatArray], xyz: FloatArray) -> Figure:
    """Draw the errors of maps of a downhill drive, the points, and a profile."""
    figure = Figure(figsize=(FULL_IN, 5.8), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.1, 1.0]).ravel()
    top, profile = above.subplots(1, 3), below.subplots()
    ground = maps["ground"]
    for axes, name in zip(top[:2], ("points alone", "and lines of sight"), strict=True):
        error = (maps[name] - ground).reshape(GRID.shape)
        image = axes.imshow(error, extent=EXTENT, cmap=ERROR, vmin=-0.8, vmax=0.8)
        axes.set_title(f"error, {name}")
    above.colorbar(image, ax=top[:2], label="error [m]", shrink=0.85, extend="both")
    top[2].plot(*xyz[:, :2].T, ",", color=INK)
    top[2].set(title="points", aspect="equal", xlim=EXTENT[:2], ylim=EXTENT[2:])
    row = int(np.argmin(np.abs(GRID.y)))
    for name, colour in (("ground", INK), ("points alone", PRIOR), ("and lines of sight", ESTIMATE)):
        profile.plot(GRID.x, maps[name].reshape(GRID.shape)[row], color=colour, label=name)
    near = np.abs(xyz[:, 1]) < 0.1
    profile.plot(xyz[near, 0], xyz[near, 2], ".", color=INK, markersize=3)
    profile.set(xlabel="east, down the lane [m]", ylabel="height [m]", title="Along the lane")
    profile.legend()
    return figure
