"""How Table 1 of the EMap paper depends on what the paper leaves open: 72 settings, fixed before any was run.

Its 1,600 nodes at 16 per m² are a square of 10 × 10 m; whether that follows the sensor or lies still is not said, nor are the
sensor's height, the springs' constants, the scans per metre that are mapped, and the resolution of its OctoMap.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from papers.emap.figures import PAPER, errors_at_nodes_cm2, write_histogram
from papers.emap.runs import EMAP, FIELD, OCTOMAP, SCENARIOS, STEP_M, OctoMapSurface, below
from papers.emap.world import (
    CRS,
    NOISE_M,
    SCAN_STEP_M,
    THRESHOLD_M,
    EmapRun,
    printed_mse_cm2,
    utilities,
    weighted_mse_cm2,
)
from papers.outputs import write_csv, write_figure
from survey import SurfacePoints
from survey.core.arrays import FloatArray, Progress
from survey.figures.style import FULL_IN, INK, ROVERS, styled
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.spring_lattice import SpringLattice
from survey.reconstruction.nodes import NodeWindow


class Lattice(NamedTuple):
    """Where the nodes lie: a square about the sensor, or one that lies still."""

    name: str
    side_m: float
    centre_xy_m: tuple[float, float] | None = None


LATTICES = (
    Lattice("20 m, follows", 20.0),
    Lattice("10 m, follows", 10.0),
    Lattice("10 m, lies still", 10.0, (5.0, 5.0)),
)
HEIGHTS_M, STIFFNESS_RATIOS, SCANS_PER_M, OCTOMAPS_M = (1.5, 2.0), (0.2, 2.0, 20.0), (2, 20), (0.10, 0.25)
RUNS = (0, 2, 4, 6, 8)
DRIVE_M = 20.0
_K_DATA = 0.5
_THRESHOLDS_M = np.arange(4.0, 10.01, 0.25)
_LARGE_CM2 = 100.0


@dataclass(frozen=True)
class SpacedRun(EmapRun):
    """A run with a spacing of its own between the scans [m]."""

    spacing_m: float = SCAN_STEP_M

    def sensors(self) -> FloatArray:
        """Return the sensor's places (n_scans, 3) [m]."""
        return super().sensors() * [self.spacing_m / SCAN_STEP_M, 1.0, 1.0]


Key = tuple[str, float, int, str]
"""Lattice, height of the sensor [m], scans per metre, and model."""
Scores = dict[Key, list[FloatArray]]
"""Of each scored scan: the error in the four scenarios, then Eq. 4 as printed at every threshold [cm²]."""


def sensitivity(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Score the springs beside OctoMap in every setting, five runs 2 m apart."""
    drives = list(product(HEIGHTS_M, SCANS_PER_M[: 1 if quick else None], RUNS[: 1 if quick else None]))
    scores: Scores = defaultdict(list)
    for k, (height_m, scans_per_m, run) in enumerate(drives, start=1):
        n_scans = int((5.0 if quick else DRIVE_M) * scans_per_m)
        drive = SpacedRun(run=run, n_scans=n_scans, sensor_height_m=height_m, spacing_m=1.0 / scans_per_m)
        _add_drive(scores, drive, scans_per_m)
        progress("drives", k, len(drives))
    rows = list(_rows({key: np.mean(found, axis=0) for key, found in scores.items()}))
    write_csv(folder / "settings.csv", _HEADING, rows)
    write_csv(folder / "shares.csv", ("lattice", "settings", *SCENARIOS, "all_four"), _shares(rows))
    write_figure(folder / "settings.png", draw_settings(rows))


def _add_drive(scores: Scores, drive: EmapRun, scans_per_m: int) -> None:
    """Map a drive by every model, and score all of them each half metre; one that lies still, while the sensor is above it."""
    octomaps = {f"OctoMap {m:g} m": OctoMapSurface(m) for m in OCTOMAPS_M}
    springs = {
        (lattice, ratio): SpringLattice(
            SpringLatticeConfig(
                step_m=STEP_M, side_m=lattice.side_m, k_surface=ratio * _K_DATA, k_data=_K_DATA
            )
        )
        for lattice in LATTICES
        for ratio in STIFFNESS_RATIOS
    }
    for k, (place, points) in enumerate(drive.scans()):
        for octomap in octomaps.values():
            octomap.insert(points)
        is_scored = k % round(SCAN_STEP_M * scans_per_m) == 0
        for lattice in LATTICES:
            if lattice.centre_xy_m is not None and place[0] > lattice.side_m - 2.0 * STEP_M:
                continue
            centre = place if lattice.centre_xy_m is None else np.array([*lattice.centre_xy_m, place[2]])
            within = _within(points, centre, lattice.side_m)
            models = {f"springs {ratio:g}": springs[lattice, ratio] for ratio in STIFFNESS_RATIOS}
            for model in models.values():
                model.update(within)
            if is_scored:
                nodes = NodeWindow.around(centre, lattice.side_m, STEP_M).xy
                heights = {name: model.predict(nodes) for name, model in models.items()}
                heights |= {name: octomap.heights(nodes) for name, octomap in octomaps.items()}
                for name, found in heights.items():
                    score = _score(found - drive.height(nodes), nodes - place[:2])
                    scores[lattice.name, drive.sensor_height_m, scans_per_m, name].append(score)


def figure_4(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Draw how the Raw scenario's errors at the nodes are spread (Fig. 4): where the lattice follows, and where it lies still."""
    follows, patch = LATTICES[0], LATTICES[-1]
    of_lattice = {follows.name: errors_at_nodes_cm2(quick=quick, progress=progress)}
    drives = [EmapRun(run=run) for run in RUNS[: 2 if quick else None]]
    runs = []
    for k, drive in enumerate(drives, start=1):
        runs.append(_errors_on_patch_cm2(drive, patch))
        progress("drives over the patch", k, len(drives))
    of_lattice[patch.name] = {m: np.mean([each[m] for each in runs], axis=0) for m in runs[0]}
    write_histogram(folder, "histogram", of_lattice[follows.name], follows.side_m)
    write_histogram(folder, "patch", of_lattice[patch.name], patch.side_m)
    rows = ((name, *(float(np.mean(of[m] > _LARGE_CM2)) for m in of)) for name, of in of_lattice.items())
    write_csv(folder / "large_errors.csv", ("lattice", *runs[0]), rows)


def _errors_on_patch_cm2(drive: EmapRun, patch: Lattice) -> dict[str, FloatArray]:
    """Return each method's mean squared error at the nodes of a patch, over the scans taken above it [cm²]."""
    lattices: dict[str, SpringLattice | FieldLattice] = {
        EMAP: SpringLattice(SpringLatticeConfig(step_m=STEP_M, side_m=patch.side_m)),
        FIELD: FieldLattice(FieldLatticeConfig(step_m=STEP_M, side_m=patch.side_m)),
    }
    octomap = OctoMapSurface(OCTOMAPS_M[0])
    found: dict[str, list[FloatArray]] = defaultdict(list)
    for place, points in drive.scans():
        if place[0] > patch.side_m - 2.0 * STEP_M:
            break
        octomap.insert(points)
        centre = np.array([*(patch.centre_xy_m or place[:2]), place[2]])
        within = _within(points, centre, patch.side_m)
        nodes = NodeWindow.around(centre, patch.side_m, STEP_M).xy
        heights = {OCTOMAP: octomap.heights(nodes)}
        for name, lattice in lattices.items():
            lattice.update(within)
            heights[name] = lattice.predict(nodes)
        for name, height in heights.items():
            found[name].append(np.square(height - drive.height(nodes)))
    return {name: 1e4 * np.mean(squared, axis=0) for name, squared in found.items()}


def _within(points: SurfacePoints, centre: FloatArray, side_m: float) -> SurfacePoints:
    """Return the points over a square, as seen from above its middle, so that a lattice lies there."""
    xyz = points.xyz[(np.abs(points.xy - centre[:2]) < 0.5 * (side_m - STEP_M)).all(axis=1)]
    return SurfacePoints(xyz, sigma_m=NOISE_M, origins=np.broadcast_to(centre, xyz.shape), crs=CRS)


def _score(error_m: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the errors of a scan [cm²]: the four scenarios, then Eq. 4 as printed at every threshold."""
    weighted = [weighted_mse_cm2(error_m, utility) for utility in utilities(offset).values()]
    r = np.hypot(*offset.T)
    moved = [np.column_stack([r - (threshold - THRESHOLD_M), 0.0 * r]) for threshold in _THRESHOLDS_M]
    return np.array([*weighted, *(printed_mse_cm2(error_m, utilities(each)["CDF"]) for each in moved)])


_HEADING = (
    *("lattice", "sensor_height_m", "k_s_over_k_d", "scans_per_m", "octomap_m"),
    *(f"{scenario}_below_percent" for scenario in SCENARIOS),
    "range_by_printed_eq4_m",
)
_N_OPEN = 5


def _rows(means: dict[Key, FloatArray]) -> Iterator[tuple[str, float, float, int, float, *tuple[float, ...]]]:
    """Yield each setting with the percentages by which springs err less than OctoMap, and the range by Eq. 4 as printed."""
    n = len(SCENARIOS)
    drives = dict.fromkeys((height_m, scans_per_m) for _, height_m, scans_per_m, _ in means)
    for lattice, (height_m, scans_per_m), ratio, octomap_m in product(
        LATTICES, drives, STIFFNESS_RATIOS, OCTOMAPS_M
    ):
        springs = means[lattice.name, height_m, scans_per_m, f"springs {ratio:g}"]
        octomap = means[lattice.name, height_m, scans_per_m, f"OctoMap {octomap_m:g} m"]
        gains = (below(float(springs[k]), float(octomap[k])) for k in range(n))
        range_m = float(_THRESHOLDS_M[springs[n:] <= octomap[n]].max(initial=0.0))
        yield lattice.name, height_m, ratio, scans_per_m, octomap_m, *gains, range_m


def _shares(
    rows: list[tuple[str, float, float, int, float, *tuple[float, ...]]],
) -> Iterator[tuple[object, ...]]:
    """Yield for each lattice, and for all, the share of settings in which springs err less than OctoMap, as the paper has it."""
    for name in (*(lattice.name for lattice in LATTICES), "all"):
        gains = np.array(
            [row[_N_OPEN : _N_OPEN + len(SCENARIOS)] for row in rows if name in (row[0], "all")], dtype=float
        )
        yield name, len(gains), *(gains > 0.0).mean(axis=0), float((gains > 0.0).all(axis=1).mean())


@styled
def draw_settings(rows: list[tuple[str, float, float, int, float, *tuple[float, ...]]]) -> Figure:
    """Draw how much less than OctoMap the springs err in every setting, and what the paper has."""
    figure = Figure(figsize=(FULL_IN, 3.2), layout="constrained")
    axes = figure.subplots()
    colours = dict(zip((lattice.name for lattice in LATTICES), ROVERS, strict=False))
    for k, scenario in enumerate(SCENARIOS):
        for j, (name, colour) in enumerate(colours.items()):
            gains = np.sort([float(row[_N_OPEN + k]) for row in rows if row[0] == name])
            x = k + 0.25 * (j - 1) + np.linspace(-0.08, 0.08, len(gains))
            axes.plot(x, np.maximum(gains, -100.0), ".", color=colour, label=name if k == 0 else None)
        octomap, emap = PAPER[scenario]
        axes.plot(
            [k - 0.4, k + 0.4], [below(emap, octomap)] * 2, color=INK, label="paper" if k == 0 else None
        )
    axes.axhline(0.0, color=INK, linewidth=0.5)
    axes.set_xticks(range(len(SCENARIOS)), SCENARIOS)
    axes.set_ylabel("error below OctoMap's [%], −100 and less at the edge")
    axes.legend()
    return figure
