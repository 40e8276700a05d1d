"""Maps of the carving paper: surfaces and bounds, cross-sections, contributions, a descent (Figs. 7 to 10 and 13)."""

from pathlib import Path

import numpy as np

from papers.carving.map_figures import (
    GRID,
    SECTIONS,
    draw_contributions,
    draw_downhill,
    draw_places,
    draw_sections,
    draw_surfaces,
    section_line,
)
from papers.carving.world import CRS, HALF_M, N_TRAIN, SENSOR_HEIGHT_M, CarvingWorld, ScanTrial
from papers.emap.world import RasterHeights
from papers.outputs import write_csv, write_figure
from survey.core.arrays import FloatArray, Progress
from survey.core.streams import stream
from survey.data.grid import Grid
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

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
    """Map what lines of sight and what points contributed (Fig. 10)."""
    trial, model = _learned(quick, progress)
    cells = Grid((-HALF_M + 0.25, -HALF_M + 0.25, HALF_M - 0.25, HALF_M - 0.25), 0.5, CRS)
    rays, points = model.contributions(cells)
    edges = np.linspace(-HALF_M, HALF_M, 61)
    counts = np.histogram2d(trial.train.xyz[:, 1], trial.train.xyz[:, 0], [edges, edges])[0][::-1]
    rows = [
        (name, float(total.sum()), float(np.mean(total > 0.0)), _share_of_half(total))
        for name, total in (("lines of sight", rays), ("points", points), ("hits", counts))
    ]
    heading = ("what", "sum", "share_of_cells_above_0", "share_of_cells_with_half_of_it")
    write_csv(folder / "contributions.csv", heading, rows)
    write_figure(folder / "contributions.png", draw_contributions(rays, points, counts))


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
