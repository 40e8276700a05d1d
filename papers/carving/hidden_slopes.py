"""Slopes that the upper bound shows without points (Fig. 4 of the carving paper).

A face falls 2.5 m from level ground, and a scanner 2.2 m above the ground looks at it from above. Behind the edge A nothing
is measured up to the first hit B on the lower ground. The upper surface is pinned to the ground at A and held down by the
lines of sight to B, so that the ground between the two is at least once as steep as the chord AB. On the nearest line of
sight over the edge the chord's slope is the angle below the horizon at which the scanner sees the edge.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.carving.world import HALF_M, SENSOR_HEIGHT_M, CarvingWorld
from papers.emap.world import RasterHeights
from papers.outputs import write_csv, write_figure
from survey import SurfacePoints
from survey.core import FloatArray, Progress, stream
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, INK, ROVERS, styled
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

FACES_DEG = (15.0, 30.0, 45.0, 60.0)
SHOWN = 45.0, 6.0
"""Face and distance of the section that is drawn."""
DISTANCES_M = (8.0, 7.0, 6.0, 5.0)
"""Distances of the scanner from the edge at its last scan [m]; nearer than 4.8 m the edge is below its view."""
FIRST_M, DRIVEN_M = 12.0, 1.0
"""Distance of its first scan, and the way between two [m]."""
EDGE_M, DROP_M = 4.0, 2.5
SECTION_X_M = np.linspace(-2.0, 13.0, 301)
_LEAST_CHORD_M = 1.0
_HALF_WIDTH_M = 2.0
_ON_FACE_M = 0.1


class Seen(NamedTuple):
    """Section across the edge: ground, estimate and upper surface (N,) [m], and the chord's ends A and B (x, z)."""

    ground: FloatArray
    estimate: FloatArray
    upper: FloatArray
    chord: tuple[FloatArray, FloatArray]

    @property
    def chord_deg(self) -> float:
        """Slope of the chord, downwards [deg]."""
        (x, z), (x_low, z_low) = self.chord
        return float(np.degrees(np.arctan2(z - z_low, x_low - x)))


def figure_4(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Bound the slope of a face that no point lies on, by the chord of the upper surface (Fig. 4)."""
    faces, distances = ((SHOWN[0],), (SHOWN[1],)) if quick else (FACES_DEG, DISTANCES_M)
    rows: list[tuple[float, ...]] = []
    shown: tuple[SurfacePoints, Seen] | None = None
    for k, face_deg in enumerate(faces):
        world = edge(face_deg)
        for n, distance_m in enumerate(distances, start=1):
            points = scans(world, distance_m)
            seen = across(world, points)
            sight_deg = float(np.degrees(np.arctan2(SENSOR_HEIGHT_M, distance_m)))
            rows.append((face_deg, distance_m, sight_deg, seen.chord_deg, n_on_face(points, face_deg)))
            if (face_deg, distance_m) == SHOWN:
                shown = points, seen
            progress("scans", k * len(distances) + n, len(faces) * len(distances))
    assert shown is not None
    write_csv(folder / "chords.csv", _HEADING, rows)
    write_figure(folder / "chords.png", _draw(rows, *shown))


_HEADING = ("face_deg", "distance_m", "sight_over_the_edge_deg", "chord_deg", "points_on_the_face")


def edge(face_deg: float) -> CarvingWorld:
    """Return level ground that falls by 2.5 m towards the east, at one angle."""
    side, step_m = HALF_M + 3.0, 0.1
    x = np.arange(-side, side + step_m / 2, step_m)
    z = np.clip(np.tan(np.radians(face_deg)) * (EDGE_M - x), -DROP_M, 0.0)
    return CarvingWorld(
        f"face of {face_deg:g}°", RasterHeights(np.tile(z, (len(x), 1)), step_m, -side, -side)
    )


def across(world: CarvingWorld, points: SurfacePoints) -> Seen:
    """Return the section across the edge, and the steepest chord from the edge to the upper surface beyond it."""
    model = SpaceCarvingKernel(SpaceCarvingConfig(first_length_m=1.0, prior_m=0.0)).fit(points)
    xy = np.column_stack([SECTION_X_M, np.zeros_like(SECTION_X_M)])
    ground, estimate = world.heights(xy), model.predict(xy)
    upper = np.maximum(model.prior_surfaces(xy)[1], estimate)
    top = int(np.argmin(np.abs(SECTION_X_M - EDGE_M)))
    beyond = np.flatnonzero(SECTION_X_M > EDGE_M + _LEAST_CHORD_M)
    slope = (ground[top] - upper[beyond]) / (SECTION_X_M[beyond] - SECTION_X_M[top])
    low = int(beyond[np.argmax(slope)])
    ends = (
        np.array([SECTION_X_M[top], ground[top]]),
        np.array([SECTION_X_M[low], upper[low]]),
    )
    return Seen(ground, estimate, upper, ends)


def scans(world: CarvingWorld, distance_m: float) -> SurfacePoints:
    """Return the hits near the section of scans on the way towards the edge, until `distance_m` before it."""
    ways_m = np.arange(FIRST_M, distance_m - 0.5 * DRIVEN_M, -DRIVEN_M)
    rng = stream(0, "carving", world.name, int(distance_m))
    points = world.scan(tuple((EDGE_M - way_m, 0.0) for way_m in ways_m.tolist()), rng)
    return points.select(np.abs(points.xyz[:, 1]) < _HALF_WIDTH_M)


def n_on_face(points: SurfacePoints, face_deg: float) -> int:
    """Return how many points lie on the face, away from its edges."""
    width_m = DROP_M / np.tan(np.radians(face_deg))
    x = points.xyz[:, 0] - EDGE_M
    return int(((x > _ON_FACE_M) & (x < width_m - _ON_FACE_M)).sum())


@styled
def _draw(rows: list[tuple[float, ...]], points: SurfacePoints, seen: Seen) -> Figure:
    """Draw one section with its chord, and the chords' slopes against the distance of the edge."""
    figure = Figure(figsize=(FULL_IN, 5.6), layout="constrained")
    section, curves = figure.subplots(2, 1)
    _draw_section(section, points, seen)
    for colour, face_deg in zip(ROVERS, sorted({row[0] for row in rows}), strict=False):
        chosen = np.array([row for row in rows if row[0] == face_deg])
        curves.plot(chosen[:, 1], chosen[:, 3], "o-", color=colour, label=f"face of {face_deg:g}°")
        curves.axhline(face_deg, color=colour, linewidth=0.6, linestyle=":")
    distance_m = np.linspace(5.0, 8.0, 31)
    sight = np.degrees(np.arctan2(SENSOR_HEIGHT_M, distance_m))
    curves.plot(
        distance_m, sight, color=INK, linewidth=0.8, linestyle="--", label="line of sight over the edge"
    )
    curves.set(xlabel="distance of the scanner from the edge [m]", ylabel="slope of the chord [°]")
    curves.legend(ncols=2)
    return figure


def _draw_section(axes: Axes, points: SurfacePoints, seen: Seen) -> None:
    near = np.abs(points.xyz[:, 1]) < 0.2
    axes.plot(SECTION_X_M, seen.ground, color=INK, linewidth=0.9, label="ground")
    axes.plot(SECTION_X_M, seen.upper, color=CLAIM, label="upper surface")
    axes.plot(SECTION_X_M, seen.estimate, color=ESTIMATE, label="estimate")
    axes.plot(points.xyz[near, 0], points.z[near], ".", color=INK, markersize=2.5, label="points")
    (x, z), (x_low, z_low) = seen.chord
    axes.plot(
        [x, x_low], [z, z_low], "o--", color=ROVERS[3], markersize=4, label=f"chord AB, {seen.chord_deg:.0f}°"
    )
    axes.annotate("A", (x, z), (0, 6), textcoords="offset points", ha="center")
    axes.annotate("B", (x_low, z_low), (0, 6), textcoords="offset points", ha="center")
    axes.set(
        xlabel="east [m]", ylabel="height [m]", ylim=(-3.2, 1.5), title="Scanner 6 m before a face of 45°"
    )
    axes.legend(ncols=3, loc="upper right")
