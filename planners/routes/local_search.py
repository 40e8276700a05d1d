"""Order and direction of swaths: local search (2-opt, or-opt, double bridges) on the lengths of true detours.

A tour is a closed row of oriented swaths. Swath ``k`` has the ends ``2k`` and ``2k + 1``; an item ``s`` of the tour is
entered at end ``s`` and left at end ``s ^ 1``. The depot is one more swath of the tour, entered where the route finishes
and left where it begins. `Transits` holds the lengths of the ways between ends, each searched when it is first needed.
The search is compiled; it finds no proven optimum.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import cKDTree

from planners.capacity import MOST_LINES
from planners.routes.visibility import Network, search
from survey.core import CapacityError, FloatArray, IntArray

_NEIGHBOURS = 10


Lengths = npt.NDArray[np.float32]


class Transits(NamedTuple):
    """Lengths of the transits between ends [m], looked up when first needed.

    An entry below zero is minus the straight distance: a bound, not yet the length.
    """

    length: Lengths  # (E, E)
    near: IntArray  # (E, K) ends of other swaths, the nearest first
    parent: IntArray  # room for the search
    network: Network


def transits(network: Network, is_free: FloatArray) -> Transits:
    """Begin the table between the network's points, two per swath, those of the depots last.

    Ends with ``is_free`` > 0 are joined to any other at no cost.
    """
    xy = network.sights.xy
    n_swaths = len(xy) // 2
    if n_swaths > MOST_LINES:
        raise CapacityError(
            f"the area cuts the swaths into {n_swaths} pieces; at most {MOST_LINES} can be ordered at once, widen the spacing or "
            "split the area."
        )
    length = np.empty((len(xy), len(xy)), dtype=np.float32)
    for row, (x, y) in enumerate(xy):
        length[row] = -np.hypot(xy[:, 0] - x, xy[:, 1] - y)
    length[is_free > 0.0] = 0.0
    length[:, is_free > 0.0] = 0.0
    parent = np.empty(len(network.bends.xy) + 1, dtype=np.int64)
    return Transits(length, _near_ends(xy), parent, network)


def _near_ends(xy: FloatArray) -> IntArray:
    """Return the ends nearest to each end (E, K), those of its own swath left out."""
    k = min(_NEIGHBOURS + 2, len(xy))
    found = np.asarray(cKDTree(xy).query(xy, k=k)[1])
    rows = np.empty((len(xy), k - 2), dtype=np.int64)
    for end, candidates in enumerate(found):
        rows[end] = [c for c in candidates if c >> 1 != end >> 1][: k - 2]
    return rows


# Moves that save less than this count as none: rounding would let the search run in circles.
_GAIN_M = 1e-3
_LONGEST_ROW = 12
"""Kicks exchange two rows of at most this many swaths; longer ones are undone more often."""


class Tour(NamedTuple):
    """The row of items and, for each swath, its place in the row, with two tables of `Transits`."""

    items: IntArray  # (n,)
    place: IntArray  # (E / 2,) -1 for swaths that are not in the row
    length: Lengths
    near: IntArray


@njit(cache=True)
def _look_up(a: int, b: int, ways: list[Transits]) -> None:
    """Search for the way between two ends, and put its length into the table [m]."""
    t = ways[0]
    t.length[a, b] = t.length[b, a] = search(a, b, t.network, t.parent)


# Compiled code counts references to every array of a tuple at each call, 0.3 µs for `Transits` and little for a list of it.
@njit(cache=True, inline="always")
def _exact(a: int, b: int, length: Lengths, ways: list[Transits]) -> float:
    """Return the length of the transit between two ends [m]; search for the way where only its bound is known."""
    if length[a, b] < 0.0:
        _look_up(a, b, ways)
    return float(length[a, b])


@njit(cache=True)
def transit_length(a: int, b: int, t: Transits) -> float:
    """Return the length of the transit between two ends [m], for callers that are not compiled."""
    return float(_exact(a, b, t.length, [t]))


@njit(cache=True)
def tour_length(items: IntArray, t: Transits) -> float:
    """Return the metres of transit of a closed tour."""
    length, ways, total = t.length, [t], 0.0
    for i in range(len(items)):
        total += _exact(items[i] ^ 1, items[(i + 1) % len(items)], length, ways)
    return total


@njit(cache=True)
def _reverse(tour: Tour, first: int, last: int) -> None:
    """Drive a row of items in the opposite order and direction."""
    items, place = tour.items, tour.place
    i, j = first, last
    while i < j:
        items[i], items[j] = items[j] ^ 1, items[i] ^ 1
        i, j = i + 1, j - 1
    if i == j:
        items[i] ^= 1
    for i in range(first, last + 1):
        place[items[i] >> 1] = i


@njit(cache=True)
def _try_reversal(end: int, tour: Tour, ways: list[Transits]) -> bool:
    """Join `end` to a nearer end by turning round the row between them (2-opt)."""
    items, place, length, near = tour
    n = len(items)
    i = place[end >> 1]
    is_left = items[i] != end
    beside = items[(i + 1) % n] if is_left else items[(i - 1) % n] ^ 1
    now = _exact(end, beside, length, ways)
    for c in near[end]:
        j = place[c >> 1]
        if j < 0 or abs(length[end, c]) >= now or (items[j] != c) != is_left:
            continue
        d = items[(j + 1) % n] if is_left else items[(j - 1) % n] ^ 1
        old = now + _exact(c, d, length, ways) - _GAIN_M
        if abs(length[end, c]) + abs(length[beside, d]) >= old:
            continue
        if _exact(end, c, length, ways) + _exact(beside, d, length, ways) >= old:
            continue
        shift = 1 if is_left else 0
        _reverse(tour, min(i, j) + shift, max(i, j) - 1 + shift)
        return True
    return False


@njit(cache=True)
def _move(tour: Tour, first: int, n_items: int, target: int) -> None:
    """Take out a row of items and put it back where it then begins at `target`."""
    items, place = tour.items, tour.place
    row = items[first : first + n_items].copy()
    # Element by element: an assignment of slices takes five seconds more to compile.
    for i in range(first - 1, target - 1, -1):
        items[i + n_items] = items[i]
    for i in range(first, target):
        items[i] = items[i + n_items]
    for i in range(n_items):
        items[target + i] = row[i]
    for i in range(min(first, target), max(first, target) + n_items):
        place[items[i] >> 1] = i


@njit(cache=True)
def _better_gap(end: int, first: int, n_items: int, tour: Tour, ways: list[Transits]) -> tuple[int, bool]:
    """Return the gap, as the place after it, that a row should move to, and whether it must be turned."""
    items, place, length, near = tour
    n = len(items)
    head, tail = items[first], items[first + n_items - 1] ^ 1
    p, q = items[first - 1] ^ 1, items[(first + n_items) % n]
    old = _exact(p, head, length, ways) + _exact(tail, q, length, ways)
    if old - abs(length[p, q]) <= _GAIN_M:
        return -1, False
    gain = old - _exact(p, q, length, ways)
    other = tail if head == end else head
    for c in near[end]:
        j = place[c >> 1]
        if j < 0 or abs(length[end, c]) >= gain or first <= j < first + n_items:
            continue
        follows = items[j] != c  # the row follows c where c is left, and precedes it where c is entered
        d = items[(j + 1) % n] if follows else items[(j - 1) % n] ^ 1
        if first <= place[d >> 1] < first + n_items or (j == 0 and not follows):
            continue
        limit = gain + _exact(c, d, length, ways) - _GAIN_M
        if abs(length[end, c]) + abs(length[other, d]) >= limit:
            continue
        if _exact(end, c, length, ways) + _exact(other, d, length, ways) < limit:
            return (j + 1 if follows else j), (head == end) != follows
    return -1, False


@njit(cache=True)
def _try_move(end: int, tour: Tour, ways: list[Transits]) -> bool:
    """Put the one to three items that begin or finish with `end` beside a nearer end (or-opt)."""
    items, place = tour.items, tour.place
    at = place[end >> 1]
    for n_items in range(1, 4):
        first = at if items[at] == end else at - n_items + 1
        if first < 1 or first + n_items > len(items):
            return False
        gap, is_turned = _better_gap(end, first, n_items, tour, ways)
        if gap >= 0:
            if is_turned:
                _reverse(tour, first, first + n_items - 1)
            _move(tour, first, n_items, gap if gap <= first else gap - n_items)
            return True
    return False


@njit(cache=True)
def _descend(tour: Tour, queue: list[int], ways: list[Transits]) -> None:
    """Apply improving moves at the queued ends, and at those beside each change, until none is left."""
    items, place = tour.items, tour.place
    waits = np.zeros(2 * len(place), dtype=np.bool_)
    for end in queue:
        waits[end] = True
    while len(queue) > 0:
        end = queue.pop()
        waits[end] = False
        while _try_reversal(end, tour, ways) or _try_move(end, tour, ways):
            at = place[end >> 1]
            for i in range(at - 2, at + 3):
                for other in (items[i % len(items)], items[i % len(items)] ^ 1):
                    if other != end and not waits[other]:
                        waits[other] = True
                        queue.append(other)


@njit(cache=True)
def _kick(tour: Tour, numbers: FloatArray) -> list[int]:
    """Exchange two neighbouring rows (a double bridge); return the six ends at the cuts."""
    items, place = tour.items, tour.place
    n = len(items)
    i = 1 + int(numbers[0] * (n - 3))
    j = min(i + 1 + int(numbers[1] * _LONGEST_ROW), n - 1)
    k = min(j + 1 + int(numbers[2] * _LONGEST_ROW), n)
    ends = [items[i - 1] ^ 1, items[i], items[j - 1] ^ 1, items[j], items[k - 1] ^ 1, items[k % n]]
    row = np.concatenate((items[j:k], items[i:j]))
    for m in range(i, k):
        items[m] = row[m - i]
        place[items[m] >> 1] = m
    return ends


@njit(cache=True)
def improved(items: IntArray, t: Transits, kicks: FloatArray) -> IntArray:
    """Return a shorter tour: 2-opt and or-opt, then kicks that are accepted when they help.

    `kicks` (K, 3) holds random numbers in [0, 1): where each one cuts.
    """
    # The arrays get names of their own: compiled code lost writes made through a tuple built in place.
    n, row = len(items), items.copy()
    place = np.full(len(t.length) // 2, -1, dtype=np.int64)
    for i in range(n):
        place[row[i] >> 1] = i
    tour, ways = Tour(row, place, t.length, t.near), [t]
    _descend(tour, [int(row[i // 2]) ^ (i % 2) for i in range(2 * n)], ways)
    best, shortest = tour_length(row, t), row.copy()
    for kick in range(len(kicks) if n > 4 else 0):
        _descend(tour, _kick(tour, kicks[kick]), ways)
        driven = tour_length(row, t)
        if driven < best - _GAIN_M:
            best, shortest = driven, row.copy()
        else:
            for i in range(n):
                row[i] = shortest[i]
                place[row[i] >> 1] = i
    return shortest


def boustrophedon(ends: FloatArray, swaths: IntArray, depot: int) -> IntArray:
    """Begin with the swaths in the given order, each entered at its nearer end."""
    items = [depot]
    here: Any = None
    for swath in swaths:
        first, second = ends[2 * swath], ends[2 * swath + 1]
        is_turned = here is not None and np.hypot(*(second - here)) < np.hypot(*(first - here))
        items.append(2 * int(swath) + int(is_turned))
        here = first if is_turned else second
    return np.array(items, dtype=np.int64)


@njit(cache=True)
def nearest_next(items: IntArray, t: Transits) -> IntArray:
    """Begin with the depot and always drive on to the nearest end of a swath not yet driven."""
    chosen, waits = items.copy(), items[1:].copy()
    length, ways = t.length, [t]
    for i in range(1, len(items)):
        here, best, pick = chosen[i - 1] ^ 1, np.inf, i - 1
        for k in range(i - 1, len(waits)):
            for end in (waits[k], waits[k] ^ 1):
                if abs(length[here, end]) < best and _exact(here, end, length, ways) < best:
                    best, pick, chosen[i] = _exact(here, end, length, ways), k, end
        waits[pick] = waits[i - 1]
    return chosen
