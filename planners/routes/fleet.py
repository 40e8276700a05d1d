"""Division of swaths among rovers so that the last one is back as early as possible.

The best single tour is cut into one row per rover by dynamic programming; then rows of swaths move from the busiest
rover to others, or are exchanged, as long as the busiest one gains (`share`). `FleetRows` is the time and energy that a
rover needs for a row; a battery divides a row into trips from the depot. `departures` delays rovers so that they keep a
distance from one another.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from planners.capacity import require_waypoints
from planners.routes.rover import Mobility, Turning, effort
from planners.routes.shortest_paths import FreeGround
from survey import ConfigError, Dem, InputError, Leg
from survey.core import FloatArray, IntArray

if TYPE_CHECKING:
    from planners.routes.tours import Tours


class FleetRows:
    """Time that a rover needs for a row of items, returns to its depot included."""

    def __init__(self, tours: "Tours", mobility: Mobility, dem: Dem | None) -> None:
        self.tours, self.mobility = tours, mobility
        self.n_rovers = len(tours.depots)
        efforts = [effort(swath, mobility, dem) for swath in tours.swaths]
        self.swath_s = np.array([e.time_s for e in efforts])
        back = [effort(swath[::-1], mobility, dem) for swath in tours.swaths]
        self.swath_j = np.maximum([e.energy_j for e in efforts], [e.energy_j for e in back])
        self.memory: dict[tuple[int, bytes], float] = {}
        self._require_battery()

    def depot(self, rover: int) -> int:
        """Return the item of a rover's depot."""
        return self.tours.first_depot + 2 * rover

    def transit_s(self, a: int, b: int) -> float:
        """Return driving time and the two turns at the ends of a transit [s]."""
        length_m = self.tours.transit_m(a, b)
        return length_m / self.mobility.speed_m_s + (2.0 * self.mobility.turn_s if length_m > 0.0 else 0.0)

    def transit_j(self, a: int, b: int) -> float:
        """Return the energy of a transit on level ground [J]."""
        return self.tours.transit_m(a, b) * self.mobility.flat_j_per_m

    def _require_battery(self) -> None:
        battery_j = self.mobility.battery_j
        if battery_j is None:
            return
        for swath, energy_j in enumerate(self.swath_j):
            ends = (2 * swath, 2 * swath + 1)
            trips = [
                self.transit_j(self.depot(r), ends[0]) + self.transit_j(ends[1], self.depot(r)) + energy_j
                for r in range(self.n_rovers)
            ]
            if max(trips) > battery_j:
                x, y = self.tours.ends[ends[0]]
                raise InputError(
                    f"the swath from ({x:.1f}, {y:.1f}) and the way there and back take {max(trips) / 1e3:.0f} kJ, but the battery "
                    f"holds {battery_j / 1e3:.0f} kJ; move the depot nearer, shorten the swaths or take a larger battery."
                )

    def seconds(self, row: IntArray, rover: int) -> float:
        """Return the time from the depot along the row and back [s], as if the battery lasted."""
        if not len(row):
            return 0.0
        key = (rover, row.tobytes())
        if key not in self.memory:
            stops = [self.depot(rover), *row.tolist(), self.depot(rover)]
            driven_s = sum(self.transit_s(a ^ 1, b) for a, b in pairwise(stops))
            self.memory[key] = driven_s + float(self.swath_s[row >> 1].sum())
        return self.memory[key]

    def _trips(self, row: IntArray, rover: int) -> list[int]:
        """Return where each trip begins so that all take the least time: the shortest path over all cuts."""
        home, battery_j, n = self.depot(rover), self.mobility.battery_j, len(row)
        if battery_j is None:
            return [0]
        best, came_from = np.full(n + 1, np.inf), np.zeros(n + 1, dtype=np.int64)
        best[0] = 0.0
        for i in range(n):
            out_s, out_j = self.transit_s(home ^ 1, row[i]), self.transit_j(home ^ 1, row[i])
            for j in range(i, n):
                if j > i:
                    out_s += self.transit_s(row[j - 1] ^ 1, row[j])
                    out_j += self.transit_j(row[j - 1] ^ 1, row[j])
                out_s += self.swath_s[row[j] >> 1]
                out_j += self.swath_j[row[j] >> 1]
                if out_j > battery_j:
                    break
                total = best[i] + self.mobility.recharge_s + out_s + self.transit_s(row[j] ^ 1, home)
                fits = out_j + self.transit_j(row[j] ^ 1, home) <= battery_j
                if fits and total < best[j + 1]:
                    best[j + 1], came_from[j + 1] = total, i
        starts, at = [], n
        while at > 0:
            at = int(came_from[at])
            starts.append(at)
        return starts

    def with_returns(self, row: IntArray, rover: int) -> IntArray:
        """Return the tour of a rover: depot, swaths, and the depot again wherever it recharges."""
        home = self.depot(rover)
        starts = set(self._trips(row, rover))
        items: list[int] = []
        for i, item in enumerate(row.tolist()):
            items += [home, item] if i in starts else [item]
        return np.array(items, dtype=np.int64)


_LONGEST_ROW = 6
_MOST_ROUNDS = 60
_MOST_PAIRS = 250
"""Exchanges are tried between short rows only; longer ones balance by giving alone."""
# Changes that save less than this count as none: rounding would let the rounds go on.
_GAIN_S = 1e-3


def share(
    swaths: Sequence[FloatArray],
    ground: FreeGround,
    depots: Any,
    *,
    finishes: Any = None,
    mobility: Mobility | None = None,
    dem: Dem | None = None,
    axes: Sequence[FloatArray] | None = None,
    turning: Turning | None = None,
) -> tuple[Leg, ...]:
    """Share the swaths among rovers that start from depots and return to them.

    The best single tour is cut into one row per rover so that the longest takes the least
    time (exact for that tour, by dynamic programming); then rows of swaths change from the
    busiest rover to others, or are exchanged, as long as the busiest one gains. With a
    battery, each rover's row is then cut into trips from its depot that take the least
    time; rovers are balanced by their driving, not by their recharging.

    `swaths`: on free ground [m]. `depots` (K, 2): where each rover starts and finishes [m]; may coincide.
    `finishes` (K, 2): where each rover finishes [m], if elsewhere; not with a battery, which is changed at
    the depot. Returns: the legs of rover 0, then those of rover 1, and so on. A rover that would bring
    nothing stays at home and has no legs; the others keep the numbers of their depots.

    The energy of a transit is taken as that of level ground while sharing; the predicted
    energy of the finished route uses the slopes. Keep a margin in the battery.

    >>> import shapely
    >>> ground = FreeGround(shapely.box(0.0, 0.0, 80.0, 100.0))
    >>> lines = [np.array([[x, 0.0], [x, 100.0]]) for x in (10.0, 30.0, 50.0, 70.0)]
    >>> legs = share(lines, ground, [(0.0, 0.0), (80.0, 0.0)])
    >>> sum(leg.rover == 0 and leg.kind == "swath" for leg in legs)
    2
    """
    places = np.array(depots, dtype=np.float64).reshape(-1, 2)
    if not len(places):
        raise ConfigError("no depot was given; name one per rover.")
    ends = places if finishes is None else np.array(finishes, dtype=np.float64).reshape(-1, 2)
    from planners.routes.tours import Tours

    tours = Tours(swaths, ground, list(zip(places, ends, strict=True)), axes=axes, turning=turning)
    return tours.until_turns_fit(lambda: _shared(tours, mobility or Mobility(), dem))


def _shared(tours: "Tours", mobility: Mobility, dem: Dem | None) -> tuple[Leg, ...]:
    """Cut the best tour into one row per rover, balance the rows, and drive them."""
    rows = FleetRows(tours, mobility, dem)
    legs: list[Leg] = []
    for rover, row in enumerate(_relieved(rows, _cut(rows, tours.best()[1:]))):
        if len(row):
            legs += tours.legs(rows.with_returns(row, rover), rover)
    return tuple(legs)


def _cut(rows: FleetRows, row: IntArray) -> list[IntArray]:
    """Cut one row into one per rover, in order, so that the busiest takes the least time; batteries apart."""
    n, k = len(row), rows.n_rovers
    inside = np.array([rows.transit_s(a ^ 1, b) for a, b in pairwise(row.tolist())])
    swath_s = rows.swath_s[row >> 1]
    # Time from the entry of the first item to the entry of item i, and on to its end.
    entry = np.r_[0.0, np.cumsum(swath_s[:-1] + inside)]
    busiest, cut = np.full((k + 1, n + 1), np.inf), np.zeros((k + 1, n + 1), dtype=np.int64)
    busiest[0, 0] = 0.0
    for rover in range(k):
        home = rows.depot(rover)
        out = np.array([rows.transit_s(home ^ 1, item) for item in row.tolist()])
        back = np.array([rows.transit_s(item ^ 1, home) for item in row.tolist()])
        busiest[rover + 1] = busiest[rover]
        cut[rover + 1] = np.arange(n + 1)
        for j in range(1, n + 1):
            alone = out[:j] + entry[j - 1] - entry[:j] + swath_s[j - 1] + back[j - 1]
            value = np.maximum(busiest[rover, :j], alone)
            i = int(np.argmin(value))
            if value[i] < busiest[rover + 1, j]:
                busiest[rover + 1, j], cut[rover + 1, j] = value[i], i
    shares, j = [], n
    for rover in range(k, 0, -1):
        i = int(cut[rover, j])
        shares.append(row[i:j])
        j = i
    return [rows.tours.ordered(part, rover) for rover, part in enumerate(shares[::-1])]


def _relieved(rows: FleetRows, shares: list[IntArray]) -> list[IntArray]:
    """Give or exchange rows of swaths between the busiest rover and the others while that helps."""
    for _ in range(_MOST_ROUNDS):
        seconds = [rows.seconds(row, rover) for rover, row in enumerate(shares)]
        busiest = int(np.argmax(seconds))
        change = _best_change(rows, shares, busiest, seconds)
        if change is None:
            break
        for rover, row in change.items():
            shares[rover] = row
    return shares


def _best_change(
    rows: FleetRows, shares: list[IntArray], busiest: int, seconds: list[float]
) -> dict[int, IntArray] | None:
    """Return new rows for two rovers such that the busier of the two takes the least time."""
    best, change = seconds[busiest] - _GAIN_S, None
    for other in range(rows.n_rovers):
        if other == busiest:
            continue
        for mine, theirs in _exchanges(rows, shares[busiest], shares[other], busiest, other):
            value = max(rows.seconds(mine, busiest), rows.seconds(theirs, other))
            if value < best:
                best, change = value, {busiest: mine, other: theirs}
    return change


def _exchanges(
    rows: FleetRows, mine: IntArray, theirs: IntArray, busiest: int, other: int
) -> list[tuple[IntArray, IntArray]]:
    """List what becomes of two rows when one to six neighbours change over, for none to six in return."""
    found = []
    for n_given in range(1, min(_LONGEST_ROW, len(mine)) + 1):
        for i in range(len(mine) - n_given + 1):
            given, rest = mine[i : i + n_given], np.delete(mine, np.s_[i : i + n_given])
            found.append((rest, _inserted(rows, theirs, given, other)))
            if len(mine) * len(theirs) > _MOST_PAIRS:
                continue
            for n_taken in range(max(n_given - 1, 1), min(n_given, len(theirs)) + 1):
                for j in range(len(theirs) - n_taken + 1):
                    taken = theirs[j : j + n_taken]
                    others = np.delete(theirs, np.s_[j : j + n_taken])
                    if rows.swath_s[taken >> 1].sum() < rows.swath_s[given >> 1].sum():
                        found.append(
                            (_inserted(rows, rest, taken, busiest), _inserted(rows, others, given, other))
                        )
    return found


def _inserted(rows: FleetRows, row: IntArray, part: IntArray, rover: int) -> IntArray:
    """Put a row, as it is or turned round, where it adds the least transit."""
    home = rows.depot(rover)
    stops = np.concatenate([[home], row, [home]])
    best, result = np.inf, row
    for turned in (part, part[::-1] ^ 1):
        for i in range(len(row) + 1):
            a, b = int(stops[i]) ^ 1, int(stops[i + 1])
            added = (
                rows.transit_s(a, int(turned[0]))
                + rows.transit_s(int(turned[-1]) ^ 1, b)
                - rows.transit_s(a, b)
            )
            if added < best:
                best, result = added, np.concatenate([row[:i], turned, row[i:]])
    return result


def departures(legs: Sequence[Leg], mobility: Mobility, separation_m: float) -> FloatArray:
    """Return how long each rover waits at its depot so that rovers keep apart on the way [s].

    Rovers depart in the order of their numbers, each as early, in steps of ten seconds, as
    it stays `separation_m` away from all before it. While one of two rovers is within twice that
    distance of its own depot, they may be nearer, so that rovers can share a depot.

    `separation_m`: smallest distance between two rovers [m]. Returns (K,): waiting time of each rover [s].
    """
    if not separation_m > 0.0:
        raise ConfigError(f"the separation is {separation_m} m; it must be greater than 0.")
    step_s = max(0.25 * separation_m / mobility.speed_m_s, 1.0)
    step_m = step_s * mobility.speed_m_s
    require_waypoints(sum(leg.length_m for leg in legs) / step_m, "the separation", 4.0 * step_m)
    tracks = [_track(legs, rover, mobility, step_s) for rover in range(max(leg.rover for leg in legs) + 1)]
    longest_s = step_s * max(len(track) for track in tracks)
    waits = np.zeros(len(tracks))
    for rover, track in enumerate(tracks):
        while any(
            _too_near(track, tracks[k], round((waits[rover] - waits[k]) / step_s), separation_m)
            for k in range(rover)
        ):
            waits[rover] += max(10.0, step_s)
            if waits[rover] > longest_s:
                raise InputError(
                    f"rover {rover + 1} cannot keep {separation_m:g} m from the others without waiting for their end; separate the depots."
                )
    return waits


def _track(legs: Sequence[Leg], rover: int, mobility: Mobility, step_s: float) -> FloatArray:
    """Return where a rover is every `step_s` (N, 2); empty for one that stays at home."""
    own = [leg.xy for leg in legs if leg.rover == rover]
    if not own:
        return np.zeros((0, 2))
    xy = np.vstack(own)
    at_s = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))] / mobility.speed_m_s
    times = np.arange(0.0, at_s[-1] + step_s, step_s)
    return np.column_stack([np.interp(times, at_s, xy[:, k]) for k in (0, 1)])


def _too_near(a: FloatArray, b: FloatArray, shift: int, separation_m: float) -> bool:
    """Return whether two rovers, the first departing `shift` steps later, meet away from their depots."""
    first, last = max(shift, 0), min(len(a) + shift, len(b))
    if last <= first:
        return False
    here, there = a[first - shift : last - shift], b[first:last]
    is_near = np.hypot(*(here - there).T) < separation_m
    at_home = np.minimum(np.hypot(*(here - a[0]).T), np.hypot(*(there - b[0]).T)) < 2.0 * separation_m
    return bool((is_near & ~at_home).any())
