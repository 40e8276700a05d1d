"""Division of swaths among rovers so that the last one is back as early as possible."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from planners.driving.energy import Mobility
from planners.driving.fleet_rows import FleetRows
from planners.driving.swath_tours import Tours
from planners.driving.turns import Turning
from planners.ground.transit import FreeGround
from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import ConfigError
from survey.data.dem import Dem
from survey.data.route import Leg

_LONGEST_ROW = 6
_MOST_ROUNDS = 60
_MOST_PAIRS = 250
"""Exchanges are tried between short rows only; longer ones balance by giving alone."""
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

    Parameters
    ----------
    swaths : sequence of (N, 2) ndarray
        On free ground [m].
    ground : FreeGround
        Where rovers may be.
    depots : (K, 2) array_like
        Where each rover starts and finishes [m]; may coincide.
    finishes : (K, 2) array_like, optional
        Where each rover finishes [m], if elsewhere; not with a battery, which is changed at the depot.
    mobility : Mobility, optional
        Speed, time for turns, energy and battery of every rover.
    dem : Dem, optional
        Heights for the energy on slopes.
    axes, turning
        As for `planners.driving.ordering.connect`.

    Returns
    -------
    tuple of Leg
        The legs of rover 0, then those of rover 1, and so on. A rover that would bring
        nothing stays at home and has no legs; the others keep the numbers of their depots.

    Raises
    ------
    InputError
        No swaths, a depot off the free ground, swaths that cannot be reached, or a swath
        that one battery does not suffice for.

    Notes
    -----
    The energy of a transit is taken as that of level ground while sharing; the predicted
    energy of the finished route uses the slopes. Keep a margin in the battery.

    Examples
    --------
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
    tours = Tours(swaths, ground, list(zip(places, ends, strict=True)), axes=axes, turning=turning)
    return tours.until_turns_fit(lambda: _shared(tours, mobility or Mobility(), dem))


def _shared(tours: Tours, mobility: Mobility, dem: Dem | None) -> tuple[Leg, ...]:
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
