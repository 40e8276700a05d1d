"""Tours of rovers through all swaths, and the legs that they drive.

`Tours` holds swaths and depots with the transits between them, and improves a tour by `planners.routes.local_search`. A
rover that cannot pivot pays for its turns; pairs of ends without room to turn are struck out and the tour is searched
again. `connect` returns the legs of one rover.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import shapely

from planners.routes.local_search import (
    Transits,
    boustrophedon,
    improved,
    nearest_next,
    tour_length,
    transit_length,
    transits,
)
from planners.routes.rover import Turning
from planners.routes.shortest_paths import FreeGround, ends_of
from planners.routes.turns import Pose, Turns, turn_length_m
from survey import FirnlineError, InputError, Leg
from survey.core import FloatArray, IntArray, stream

_KICKS_PER_SWATH, _MOST_KICKS, _KICKS_PER_SHARE = 25, 5_000, 200
# Swath ends nearer to one another than so many turning radii are charged with the length of their turn: beyond, a turn is
# hardly longer than the straight way. Transits that no turn fits are struck out by a length that no tour takes.
_TURN_REACH, _MOST_STRUCK_OUT, _NO_WAY_M = 8.0, 20, 1e6


class _NoTurnError(InputError):
    """Two ends between which the ground leaves no room to turn."""

    def __init__(self, message: str, ends: tuple[int, int]) -> None:
        super().__init__(message)
        self.ends = ends


class Tours:
    """The swaths and depots (start, end) of one or more rovers, and the transits between them."""

    def __init__(
        self,
        swaths: Sequence[FloatArray],
        ground: FreeGround,
        depots: Sequence[tuple[Any, Any]],
        *,
        axes: Sequence[FloatArray] | None = None,
        turning: Turning | None = None,
    ) -> None:
        if not swaths:
            raise InputError("there are no swaths to connect; lay at least one.")
        self.swaths, self.ground, self.axes = swaths, ground, axes
        self.turns = Turns(ground, turning) if turning is not None and turning.turn_radius_m > 0.0 else None
        self.depots = list(depots)
        here = swaths[0][0]
        places = [here if place is None else place for start, end in self.depots for place in (end, start)]
        depot_xy = np.array(places, dtype=np.float64).reshape(-1, 2)
        _require_on_ground(ground, depot_xy)
        self.ends = np.vstack([ends_of(swaths), depot_xy])
        inside = ground.inside(self.ends)
        _require_joined(ground, inside, len(swaths))
        is_free = np.zeros(len(self.ends))
        is_free[2 * len(swaths) :] = [place is None for start, end in self.depots for place in (end, start)]
        self.transits: Transits = transits(ground.network(inside), is_free)
        if self.turns is not None:
            self._charge_turns(self.turns.turning)

    @property
    def first_depot(self) -> int:
        """Return the item of the first depot: entered at the route's end, left at its start."""
        return 2 * len(self.swaths)

    def best(self, swaths: IntArray | None = None, depot: int = 0, *, n_kicks: int | None = None) -> IntArray:
        """Return items in the best order found, beginning with the depot."""
        chosen = np.arange(len(self.swaths)) if swaths is None else swaths
        item = self.first_depot + 2 * depot
        given = boustrophedon(self.ends, chosen, item)
        nearest = nearest_next(given, self.transits)
        shorter = tour_length(nearest, self.transits) < tour_length(given, self.transits) - 1e-3
        return self.better(nearest if shorter else given, n_kicks=n_kicks)

    def better(self, items: IntArray, *, n_kicks: int | None = None) -> IntArray:
        """Return a tour of the same swaths that is no longer."""
        n = min(_KICKS_PER_SWATH * len(items), _MOST_KICKS) if n_kicks is None else n_kicks
        kicks = stream(0, "ordering").random((n, 3))
        return _from_depot(improved(items, self.transits, kicks), int(items[0]))

    def ordered(self, items: IntArray, depot: int) -> IntArray:
        """Return some items in the best order found for a depot, the depot itself left out."""
        if not len(items):
            return items
        start = np.concatenate([[self.first_depot + 2 * depot], items])
        return self.better(start, n_kicks=_KICKS_PER_SHARE)[1:]

    def transit_m(self, a: int, b: int) -> float:
        """Return the length of the transit between two ends [m]."""
        return float(transit_length(int(a), int(b), self.transits))

    def driven(self, rover: int = 0) -> tuple[Leg, ...]:
        """Return the legs of the best tour."""
        return self.until_turns_fit(lambda: self.legs(self.best(), rover))

    def until_turns_fit(self, drive: Callable[[], tuple[Leg, ...]]) -> tuple[Leg, ...]:
        """Return the result of `drive`, repeated without the turns that find no room."""
        struck_out: list[_NoTurnError] = []
        while True:
            try:
                return drive()
            except _NoTurnError as error:
                struck_out.append(error)
                if len(struck_out) > _MOST_STRUCK_OUT:
                    raise InputError(str(struck_out[0])) from error
                a, b = error.ends
                self.transits.length[a, b] = self.transits.length[b, a] = _NO_WAY_M

    def legs(self, tour: IntArray, rover: int = 0) -> tuple[Leg, ...]:
        """Return the legs of a tour, every metre of them checked to be on the free ground."""
        legs: list[Leg] = []
        depot = int(tour[0])
        start, end = self.depots[(depot - self.first_depot) // 2]
        here = None if start is None else depot + 1
        for item in tour[1:].tolist():
            legs += self._transit(here, item, rover)
            if item < self.first_depot:
                legs.append(self._swath(item, rover))
            here = item ^ 1
        if end is not None:
            legs += self._transit(here, depot, rover)
        _require_covered(self.ground, legs)
        return tuple(legs)

    def _swath(self, item: int, rover: int) -> Leg:
        way = -1 if item & 1 else 1
        axis = None if self.axes is None else self.axes[item >> 1][::way]
        return Leg("swath", self.swaths[item >> 1][::way], rover, axis)

    def _transit(self, a: int | None, b: int, rover: int) -> list[Leg]:
        if a is None or np.array_equal(self.ends[a], self.ends[b]):
            return []
        if self.turns is None:
            xy = self.ground.between(self.ends, self.transits.network, a, b)
        else:
            try:
                xy = self.turns.between(self._pose(a, self.ends[b]), _turned(self._pose(b, self.ends[a])))
            except InputError as error:
                raise _NoTurnError(str(error), (a, b)) from error
        return [Leg("transit", xy, rover)]

    def _pose(self, end: int, other: FloatArray) -> Pose:
        """Return the pose of a rover that has just come out of an end; at a depot it faces the other end."""
        here = self.ends[end]
        before = here - (other - here)
        if end < self.first_depot:
            swath = self.swaths[end >> 1]
            before = swath[-2] if end & 1 else swath[1]
        ahead = here - before
        return float(here[0]), float(here[1]), float(np.arctan2(ahead[1], ahead[0]))

    def _charge_turns(self, turning: Turning) -> None:
        """Replace the lengths of short transits by those of the turns that they take."""
        length = self.transits.length
        for a in range(self.first_depot):
            for b in self.transits.near[a].tolist():
                straight = abs(float(length[a, b]))
                if b < self.first_depot and straight < _TURN_REACH * turning.turn_radius_m:
                    pose = self._pose(a, self.ends[b])
                    turn = turn_length_m(pose, _turned(self._pose(b, self.ends[a])), turning)
                    length[a, b] = length[b, a] = max(turn, straight)


def _turned(pose: Pose) -> Pose:
    return pose[0], pose[1], pose[2] + np.pi


def _from_depot(tour: IntArray, depot: int) -> IntArray:
    """Turn and rotate a closed tour until it leaves the depot at the start."""
    at = int(np.flatnonzero(tour >> 1 == depot >> 1)[0])
    if tour[at] != depot:
        tour = tour[::-1] ^ 1
        at = len(tour) - 1 - at
    return np.roll(tour, -at)


def _require_on_ground(ground: FreeGround, points: FloatArray) -> None:
    for x, y in points:
        if not ground.covers(shapely.Point(x, y)) and not ground.inner.dwithin(shapely.Point(x, y), 0.01):
            raise InputError(
                f"the point ({x:.1f}, {y:.1f}) is outside the free ground (in a no-go zone, too steep or outside the area); move it."
            )


def _require_joined(ground: FreeGround, points: FloatArray, n_swaths: int) -> None:
    """Refuse swaths on parts of the ground that no way joins to the start's part."""
    parts = ground.part_of(points)
    of_swaths = parts[: 2 * n_swaths]
    cut_off = sorted(set(of_swaths.tolist()) - {int(parts[-1])})
    if not cut_off:
        return
    first = ground.parts[cut_off[0]]
    place = first.representative_point()
    n_swaths = int(np.isin(of_swaths[::2], cut_off).sum())
    raise InputError(
        f"{n_swaths} swaths lie on {len(cut_off)} parts of the ground that no way joins to the rest; the largest, {first.area:.0f} m² around "
        f"({place.x:.1f}, {place.y:.1f}), is cut off by no-go, impassable or outside ground: start a rover there or leave that part out."
    )


def _require_covered(ground: FreeGround, legs: list[Leg]) -> None:
    """Prove that no metre of any leg lies outside the ground."""
    lines = np.array([shapely.linestrings(leg.xy) for leg in legs])
    outside = np.flatnonzero(~ground.covers(lines))
    if len(outside):
        leg = legs[outside[0]]
        raise FirnlineError(
            f"a {leg.kind} from {leg.xy[0]} to {leg.xy[-1]} leaves the free ground; its swath must be clipped to the ground first."
        )


def connect(
    swaths: Sequence[FloatArray],
    ground: FreeGround,
    *,
    start: Any = None,
    end: Any = None,
    axes: Sequence[FloatArray] | None = None,
    turning: Turning | None = None,
    rover: int = 0,
) -> tuple[Leg, ...]:
    """Order the swaths and join them by the shortest transits that stay on the free ground.

    The swaths form a tour whose transits are as short as a local search finds them
    (2-opt and or-opt with turned swaths, then random double bridges; Lourenço et al.
    2003), each transit measured along its true detour. It is no proven optimum; on
    sites with many no-go zones it stays a few percent above the best known tours.

    `swaths`: straight or winding, each on free ground [m]. `start`, `end` (2,): where the rover starts and
    has to finish [m]; anywhere by default. `axes`: the straight line that each swath deviates from [m]; its
    first and last point by default.

    >>> import numpy as np
    >>> import shapely
    >>> ground = FreeGround(shapely.box(0.0, 0.0, 40.0, 100.0))
    >>> lines = [np.array([[x, 0.0], [x, 100.0]]) for x in (10.0, 30.0)]
    >>> [leg.kind for leg in connect(lines, ground)]
    ['swath', 'transit', 'swath']
    """
    tour = Tours(swaths, ground, [(start, end)], axes=axes, turning=turning)
    return tour.driven(rover)
