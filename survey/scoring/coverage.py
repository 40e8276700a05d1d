"""Coverage of an area by the samples of a route, their spread, and coverage by the nodes of a map.

`Coverage` measures a route over an area: science-centric coverage (Eq. 11 of the glacier paper,
`science_coverage`), the share of cells visited, robot-centric coverage, centeredness α (Eqs. 12 and 13) and
distributedness β (Eqs. 14 to 16). `mapped_share` is the share of an area's free ground on which a map gives a
height; `count_nodes` counts the nodes that a score leaves out, by reason.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import shapely

from survey.core import BoolArray, Bounds, FloatArray, InputError, IntArray
from survey.core.map_scale import MapScale
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route, RouteSamples

# A sample on the edge between two cells counts for the north-eastern one whatever the rounding.
_SLACK_CELLS = 1e-6


@dataclass(frozen=True)
class SampleCells:
    """Every place of an area where a sample could be taken: cells as wide as the samples' spacing.

    The cells are counted from the south-western corner of the area's bounds; a cell belongs
    to the area when its centre lies on free ground.

    `area`: the ground to be mapped. `step_m`: width of a cell [m].

    >>> cells = SampleCells(SurveyArea.rectangle((0.0, 0.0, 30.0, 20.0), "EPSG:32608"), 10.0)
    >>> len(cells.centres)
    6
    """

    area: SurveyArea
    step_m: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.step_m) and self.step_m > 0.0):
            raise InputError(f"the sample spacing is {self.step_m} m; it must be greater than 0.")
        if not self._inside.any():
            raise InputError(
                f"no centre of a {self.step_m:g} m cell lies in the survey area; sample more finely."
            )

    @property
    def _shape(self) -> tuple[int, int]:
        """Number of rows (from the south) and columns that cover the area's bounds."""
        xmin, ymin, xmax, ymax = self.area.bounds
        rows, columns = ((side / self.step_m) for side in (ymax - ymin, xmax - xmin))
        return max(1, int(np.ceil(rows - 1e-9))), max(1, int(np.ceil(columns - 1e-9)))

    @cached_property
    def _all_centres(self) -> FloatArray:
        xmin, ymin, _, _ = self.area.bounds
        rows, columns = np.indices(self._shape)
        return np.column_stack(
            [xmin + (columns.ravel() + 0.5) * self.step_m, ymin + (rows.ravel() + 0.5) * self.step_m]
        )

    @cached_property
    def _inside(self) -> BoolArray:
        return self.area.contains(self._all_centres)

    @property
    def centres(self) -> FloatArray:
        """Centres (S, 2) of the area's cells [m], row by row from the south-west."""
        return self._all_centres[self._inside]

    def visited(self, xy: Any) -> FloatArray:
        """Return the centres (M, 2) of the area's cells that hold one or more of the places (N, 2).

        Places on the area's northern and eastern bounds count for the cell that ends there.

        `xy` (N, 2): easting and northing [m]. Returns (M, 2): each cell once [m].
        """
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        xmin, ymin, xmax, ymax = self.area.bounds
        slack = _SLACK_CELLS * self.step_m
        near = (points >= (xmin - slack, ymin - slack)).all(axis=1)
        near &= (points <= (xmax + slack, ymax + slack)).all(axis=1)
        index = np.unique(self._index(points[near]))
        return self._all_centres[index[self._inside[index]]]

    def _index(self, points: FloatArray) -> IntArray:
        xmin, ymin, _, _ = self.area.bounds
        rows, columns = self._shape
        cell = np.floor((points - (xmin, ymin)) / self.step_m + _SLACK_CELLS).astype(np.int64)
        column, row = np.clip(cell, 0, (columns - 1, rows - 1)).T
        index: IntArray = row * columns + column
        return index


def science_coverage(samples: Any, possible: Any, reference: Any) -> float:
    r"""Return the share of an area's scientific value that samples reach (Eq. 11 of the glacier paper).

    .. math::  SCC = \sum_{m=1}^M \|x_m - x_{ref}\| \Big/ \sum_{s=1}^S \|x_s - x_{ref}\|

    `samples` (M, 2): easting and northing of the samples, each place once [m]. `possible` (S, 2): every place
    where a sample could be taken [m]. `reference` (2,): the point from which value is counted [m]. Returns:
    between 0 and 1 when the samples are among the possible ones.

    The weight makes a sample at the reference worth nothing and one in the farthest corner
    worth most; read it beside the plain share of cells.

    >>> square = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]
    >>> science_coverage(square[:2], square, (0.5, 0.5))
    0.5
    """

    def total(places: Any) -> float:
        offsets = np.asarray(places, dtype=np.float64).reshape(-1, 2) - np.asarray(reference)
        return float(np.hypot(*offsets.T).sum())

    whole = total(possible)
    if whole == 0.0:
        raise InputError(
            "every possible sample lies on the reference point; give a larger area or finer samples."
        )
    return total(samples) / whole


@dataclass(frozen=True)
class Coverage:
    """How much of the area a route sampled, and how evenly; ``None`` where there was no route.

    Parameters
    ----------
    scc : float
        Science-centric coverage, 0 to 1 (Eq. 11).
    cells_share : float
        Plain share of the area's cells that were visited.
    robot_centric : float
        Distance driven over the distance that would visit every cell in lines one cell
        apart (:math:`D_S / D_T`); above 1 when the route crosses itself a lot.
    alpha : float
        Centeredness of the samples, 0 is best (Eqs. 12 and 13).
    beta : float
        Distributedness about the swaths (Eqs. 14 to 16); 0 for straight swaths, ``None``
        where it is not defined.
    """

    scc: float | None = None
    cells_share: float | None = None
    robot_centric: float | None = None
    alpha: float | None = None
    beta: float | None = None

    @classmethod
    def of(cls, route: Route, area: SurveyArea, sample_step_m: float = 10.0) -> Self:
        """Measure a route over an area, sampled at equal steps along everything driven.

        Parameters
        ----------
        route : Route
            Swaths and transits of all rovers; transits count for all but β.
        area : SurveyArea
            In the same CRS. Its reference point is the one of Eqs. 11 and 13.
        sample_step_m : float
            Distance between samples, and width of the cells [m]; on the ground where the scale factor of the
            CRS differs from 1 by more than 1 %.

        Raises
        ------
        InputError
            Mixed CRS, a step that is not positive or larger than the area.

        Examples
        --------
        >>> from survey.data.route import Leg
        >>> area = SurveyArea.rectangle((0.0, 0.0, 40.0, 40.0), "EPSG:32608")
        >>> line = Route((Leg("swath", [[5.0, 5.0], [5.0, 35.0]]),), "EPSG:32608", "line")
        >>> coverage = Coverage.of(line, area)
        >>> coverage.cells_share, coverage.beta
        (0.25, 0.0)
        """
        area.require_crs(route.crs, "the route")
        step_m = sample_step_m * MapScale.over(area.crs, area.bounds).notable_factor
        cells = SampleCells(area, step_m)
        tracks = [route.sample(step_m, rover) for rover in range(route.n_rovers)]
        samples = np.vstack([track.xy for track in tracks])
        visited, possible = cells.visited(samples), cells.centres
        return cls(
            scc=science_coverage(visited, possible, area.reference),
            cells_share=len(visited) / len(possible),
            robot_centric=route.length_m / (len(possible) * step_m),
            alpha=centeredness(samples, area.reference, area.farthest_m),
            beta=distribution(route, tracks),
        )


SHORTEST_STEP_M = 1.0
"""Cross-track steps below this are left out of Eq. 15 [m]."""
# A straight swath deviates from its axis by rounding alone.
_STRAIGHT_M = 1e-6


def centeredness(samples: Any, reference: Any, farthest_m: float) -> float:
    r"""Return the distance of the samples' centre of mass from the reference, relative (α, Eqs. 12 and 13).

    .. math::  \alpha = \| \tfrac{1}{M} \sum_m x_m - x_{ref} \| / D_{max}

    `samples` (M, 2): easting and northing of every sample taken, repeats included [m]. `reference` (2,): the
    centre of the area [m]. `farthest_m`: :math:`D_{max}`: distance from the reference to the farthest point
    of the area [m]. Returns: 0 (best) to 1.

    Samples crowded around the centre and samples along the border both give 0.

    >>> centeredness([[0.0, 0.0], [6.0, 8.0]], (0.0, 0.0), farthest_m=10.0)
    0.5
    """
    points = np.asarray(samples, dtype=np.float64).reshape(-1, 2)
    if len(points) == 0 or not farthest_m > 0.0:
        raise InputError(
            f"centeredness needs samples and an area around the reference; there are {len(points)} samples and "
            f"{farthest_m} m to the farthest point."
        )
    return float(np.hypot(*(points.mean(axis=0) - np.asarray(reference)))) / farthest_m


def distribution(route: Route, tracks: Sequence[RouteSamples]) -> float | None:
    r"""Return the mean distance from the swath over the mean step across it (β, Eqs. 14 to 16).

    .. math::  \beta_a = \frac{1}{M} \sum_{m=1}^M |y_m|, \quad
               \beta_b = \frac{1}{K} \sum_{|y_m - y_{m+1}| \ge 1\,\mathrm{m}} |y_m - y_{m+1}|, \quad
               \beta = \beta_a / \beta_b

    with y the distance of a sample from the axis of its own swath and K the number of
    those steps. The paper divides by M − 1 in any case; steps from one swath to the
    next and samples on transits are left out here.

    Returns: 0 for straight swaths; ``None`` when swaths deviate but never by a metre from one sample to the
    next, or when no sample lies on a swath.

    >>> from survey.data.route import Leg
    >>> zigzag = Leg("swath", [[0, 0], [6, 8], [12, 0]], axis=[[0, 0], [12, 0]])
    >>> route = Route((zigzag,), "EPSG:32608", "zigzag")
    >>> distribution(route, [route.sample(5.0)])
    0.8
    """
    offsets = [
        _across(route.legs[leg].axis, track.xy[track.leg == leg])
        for track in tracks
        for leg in np.unique(track.leg)
        if route.legs[leg].kind == "swath"
    ]
    if not offsets:
        return None
    mean_offset_m = float(np.abs(np.concatenate(offsets)).mean())
    if mean_offset_m < _STRAIGHT_M:
        return 0.0
    steps = np.concatenate([np.abs(np.diff(y)) for y in offsets])
    # The slack lets a step of exactly 1 m count whatever the rounding.
    steps = steps[steps >= SHORTEST_STEP_M - _STRAIGHT_M]
    return mean_offset_m / float(steps.mean()) if len(steps) else None


def _across(axis: FloatArray, xy: FloatArray) -> FloatArray:
    """Return the signed distance (N,) of places from the straight line through both ends of an axis [m]."""
    (x0, y0), (x1, y1) = axis
    length = float(np.hypot(x1 - x0, y1 - y0))
    if length == 0.0:
        raise InputError(
            f"a swath's axis starts and ends at ({x0:.1f}, {y0:.1f}); give it two different ends."
        )
    signed: FloatArray = ((x1 - x0) * (xy[:, 1] - y0) - (y1 - y0) * (xy[:, 0] - x0)) / length
    return signed


class NodeCounts(NamedTuple):
    """Numbers of nodes that a score leaves out.

    `outside`: outside the area. `unknown`: in the area, with a height in the map and none in the reference.
    `silent`: in the area, without a height in the map.
    """

    outside: int
    unknown: int
    silent: int


def count_nodes(
    heights: FloatArray, reference: FloatArray, inside: BoolArray, *, has_area: bool
) -> NodeCounts:
    """Count the nodes (N,) that are left out, by reason.

    Where no area was named, nodes at which neither map nor reference has a height count as outside.
    """
    given, known = np.isfinite(heights), np.isfinite(reference)
    wanted = inside if has_area else inside & (given | known)
    return NodeCounts(
        outside=int((~wanted).sum()),
        unknown=int((wanted & given & ~known).sum()),
        silent=int((wanted & ~given).sum()),
    )


def nodes_beyond(bounds: Bounds, step_m: float, area: SurveyArea) -> int:
    """Return the number of nodes that the part of an area beyond a raster's bounds would hold."""
    beyond_m2 = float(area.free.difference(shapely.box(*bounds)).area)
    return round(beyond_m2 / step_m**2)


def mapped_share(dem: Dem, area: SurveyArea) -> float:
    """Return the share of an area's free ground on which a map gives a height.

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.5, 0.5, 9.5, 9.5), 1.0, "EPSG:32608")
    >>> area = SurveyArea.rectangle((0.0, 0.0, 20.0, 10.0), "EPSG:32608")
    >>> mapped_share(Dem.on(grid, np.zeros(grid.shape)), area)
    0.5
    """
    inside = area.contains(dem.xy)
    given = int((inside & np.isfinite(dem.elevation.ravel())).sum())
    wanted = int(inside.sum()) + nodes_beyond(dem.bounds, dem.step_m, area)
    return given / wanted if wanted else 0.0
