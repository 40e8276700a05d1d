"""From swaths to legs: the order and direction of driving, joined by transits on free ground."""

from typing import Any

import numpy as np
import shapely

from planners.decomposition import ends_of
from planners.tours import Transits, boustrophedon, improved, nearest_next, tour_length, transits
from planners.transit import FreeGround
from survey.arrays import FloatArray, IntArray
from survey.errors import FirnlineError, InputError
from survey.route import Leg
from survey.streams import stream

_KICKS_PER_SWATH, _MOST_KICKS = 25, 5_000


def connect(
    swaths: list[FloatArray],
    ground: FreeGround,
    *,
    start: Any = None,
    end: Any = None,
    rover: int = 0,
) -> tuple[Leg, ...]:
    """Order the swaths and join them by the shortest transits that stay on the free ground.

    The swaths form a tour whose transits are as short as a local search finds them
    (2-opt and or-opt with turned swaths, then random double bridges; Lourenço et al.
    2003), each transit measured along its true detour. It is no proven optimum; on
    sites with many no-go zones it stays a few percent above the best known tours.

    Parameters
    ----------
    swaths : list of (N, 2) ndarray
        Straight or winding, each on free ground [m].
    ground : FreeGround
        Where rovers may be.
    start, end : (2,) array_like, optional
        Where the rover starts and has to finish [m]; anywhere by default.
    rover : int
        Who drives the legs.

    Returns
    -------
    tuple of Leg
        Swaths and transits in driving order. Without a `start`, a site that is swept
        best in the given order begins with the first swath in its given direction.

    Raises
    ------
    InputError
        No swaths, a start or end off the free ground, or swaths that no way joins;
        the message names the part of the ground that is cut off.

    Examples
    --------
    >>> ground = FreeGround(shapely.box(0.0, 0.0, 40.0, 100.0))
    >>> lines = [np.array([[x, 0.0], [x, 100.0]]) for x in (10.0, 30.0)]
    >>> [leg.kind for leg in connect(lines, ground)]
    ['swath', 'transit', 'swath']
    """
    tour = Tour(swaths, ground, start, end)
    return tour.legs(tour.best(), rover)


class Tour:
    """The swaths of one rover, their ends and the transits between them."""

    def __init__(
        self, swaths: list[FloatArray], ground: FreeGround, start: Any = None, end: Any = None
    ) -> None:
        if not swaths:
            raise InputError("there are no swaths to connect; lay at least one.")
        self.swaths, self.ground = swaths, ground
        self.has_start, self.has_end = start is not None, end is not None
        anywhere = swaths[0][0]
        depot = np.array(
            [anywhere if end is None else end, anywhere if start is None else start], dtype=float
        )
        _require_on_ground(ground, depot)
        self.ends = np.vstack([ends_of(swaths), depot])
        inside = ground.inside(self.ends)
        _require_joined(ground, inside)
        is_free = np.zeros(len(self.ends))
        is_free[-2:] = [not self.has_end, not self.has_start]
        self.transits: Transits = transits(ground.network(inside), is_free)

    @property
    def depot(self) -> int:
        """The tour's first item: entered at the route's end, left at its start."""
        return len(self.ends) - 2

    def best(self) -> IntArray:
        """Return the items (n_swaths + 1,) in the best order found, the depot first."""
        given = boustrophedon(self.ends, self.depot)
        nearest = nearest_next(given, self.transits)
        shorter = tour_length(nearest, self.transits) < tour_length(given, self.transits) - 1e-3
        n_kicks = min(_KICKS_PER_SWATH * len(self.swaths), _MOST_KICKS)
        kicks = stream(0, "ordering").random((n_kicks, 3))
        tour = improved(nearest if shorter else given, self.transits, kicks)
        return _from_depot(tour, self.depot)

    def legs(self, tour: IntArray, rover: int = 0) -> tuple[Leg, ...]:
        """Return the legs of a tour, every metre of them checked to be on the free ground."""
        legs: list[Leg] = []
        here = self.depot + 1 if self.has_start else None
        for item in tour[1:]:
            legs += self._transit(here, item, rover)
            swath = self.swaths[item >> 1]
            legs.append(Leg("swath", swath[::-1] if item & 1 else swath, rover))
            here = item ^ 1
        if self.has_end:
            legs += self._transit(here, self.depot, rover)
        _require_covered(self.ground, legs)
        return tuple(legs)

    def _transit(self, a: int | None, b: int, rover: int) -> list[Leg]:
        if a is None or np.array_equal(self.ends[a], self.ends[b]):
            return []
        return [Leg("transit", self.ground.between(self.ends, self.transits.network, a, b), rover)]


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


def _require_joined(ground: FreeGround, points: FloatArray) -> None:
    """Refuse swaths on parts of the ground that no way joins to the start's part."""
    parts = ground.part_of(points)
    home = parts[-1]
    cut_off = sorted(set(parts[:-2].tolist()) - {int(home)})
    if not cut_off:
        return
    first = ground.parts[cut_off[0]]
    place = first.representative_point()
    n_swaths = int(np.isin(parts[:-2:2], cut_off).sum())
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
