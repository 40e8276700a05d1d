"""Stencil of the prior, compiled: thin plate, membrane and mass on a lattice with free edges."""

from numba import njit

from survey.core.arrays import FloatArray

Weights = tuple[float, float, float]
"""Of the thin plate, the membrane and the mass [1/m²]."""


Line = tuple[float, float, float, float]


@njit(cache=True, inline="always")
def prior_of_inner_row(weights: Weights, z: FloatArray, j: int, out: FloatArray) -> None:
    """Set the prior's part of a row that is two nodes or more from the edge, between columns 2 and -3."""
    plate, membrane, mass = weights
    own = 20.0 * plate + 4.0 * membrane + mass
    beside, across = 8.0 * plate + membrane, 2.0 * plate
    row, south, north, farther_south, farther_north = z[j], z[j - 1], z[j + 1], z[j - 2], z[j + 2]
    into = out[j]
    for i in range(2, len(row) - 2):
        into[i] = (
            own * row[i]
            - beside * (row[i - 1] + row[i + 1] + south[i] + north[i])
            + across * (south[i - 1] + south[i + 1] + north[i - 1] + north[i + 1])
            + plate * (row[i - 2] + row[i + 2] + farther_south[i] + farther_north[i])
        )


@njit(cache=True, inline="always")
def _outermost(weights: Weights, a: Line, before: Line, after: Line, ends: float) -> float:
    """Return the prior's part at a node on an edge.

    `a` are its own height and the next three inwards, `before` and `after` the same of its
    neighbours along the edge, and `ends` the sum of the heights two nodes along the edge.
    """
    plate, membrane, mass = weights
    along = before[0] + after[0]
    inwards = a[0] - 2.0 * a[1] + a[2]
    twist = 4.0 * (a[0] - a[1]) - 2.0 * along + 2.0 * (before[1] + after[1])
    springs = 3.0 * a[0] - a[1] - along
    return plate * (inwards + ends - 4.0 * along + 6.0 * a[0] + twist) + membrane * springs + mass * a[0]


@njit(cache=True, inline="always")
def _next_to_edge(weights: Weights, a: Line, before: Line, after: Line, ends: float) -> float:
    """Return the prior's part at a node one step from an edge; the heights as for `_outermost`."""
    plate, membrane, mass = weights
    along = before[1] + after[1]
    inwards = -2.0 * a[0] + 5.0 * a[1] - 4.0 * a[2] + a[3]
    diagonal = before[0] + after[0] + before[2] + after[2]
    twist = 8.0 * a[1] - 4.0 * (a[0] + a[2] + along) + 2.0 * diagonal
    springs = 4.0 * a[1] - a[0] - a[2] - along
    return plate * (inwards + ends - 4.0 * along + 6.0 * a[1] + twist) + membrane * springs + mass * a[1]


@njit(cache=True)
def prior_of_edge_rows(weights: Weights, z: FloatArray, out: FloatArray) -> None:
    """Set the prior's part of the two rows at either edge, corners apart."""
    rows, columns = z.shape
    for edge in range(2):
        at, inwards = (0, 1) if edge == 0 else (rows - 1, -1)
        p, q, r, s = z[at], z[at + inwards], z[at + 2 * inwards], z[at + 3 * inwards]
        outer, inner = out[at], out[at + inwards]
        for i in range(2, columns - 2):
            a = (p[i], q[i], r[i], s[i])
            west, east = (p[i - 1], q[i - 1], r[i - 1], 0.0), (p[i + 1], q[i + 1], r[i + 1], 0.0)
            outer[i] = _outermost(weights, a, west, east, p[i - 2] + p[i + 2])
            inner[i] = _next_to_edge(weights, a, west, east, q[i - 2] + q[i + 2])


@njit(cache=True, inline="always")
def prior_of_row_ends(weights: Weights, z: FloatArray, j: int, out: FloatArray) -> None:
    """Set the prior's part of the two nodes at either end of a row that is not at an edge itself."""
    columns = z.shape[1]
    row, south, north, farther_south, farther_north = z[j], z[j - 1], z[j + 1], z[j - 2], z[j + 2]
    for edge in range(2):
        i, n = (0, 1) if edge == 0 else (columns - 1, -1)
        a = (row[i], row[i + n], row[i + 2 * n], row[i + 3 * n])
        before = (south[i], south[i + n], south[i + 2 * n], 0.0)
        after = (north[i], north[i + n], north[i + 2 * n], 0.0)
        out[j, i] = _outermost(weights, a, before, after, farther_south[i] + farther_north[i])
        out[j, i + n] = _next_to_edge(weights, a, before, after, farther_south[i + n] + farther_north[i + n])


@njit(cache=True)
def prior_at_node(weights: Weights, z: FloatArray, j: int, i: int) -> float:
    """Return the prior's part at one node, as the gradient of the bends and springs that it belongs to."""
    plate, membrane, mass = weights
    rows, columns = z.shape
    total = mass * z[j, i]
    for k in (-1, 1):
        if 0 <= i + k < columns:
            total += membrane * (z[j, i] - z[j, i + k])
        if 0 <= j + k < rows:
            total += membrane * (z[j, i] - z[j + k, i])
    for k in (-1, 0, 1):
        share = plate if k else -2.0 * plate
        c = i + k
        if 0 < c < columns - 1:
            total += share * (z[j, c - 1] - 2.0 * z[j, c] + z[j, c + 1])
        r = j + k
        if 0 < r < rows - 1:
            total += share * (z[r - 1, i] - 2.0 * z[r, i] + z[r + 1, i])
    for r in (j - 1, j + 1):
        for c in (i - 1, i + 1):
            if 0 <= r < rows and 0 <= c < columns:
                total += 2.0 * plate * (z[j, i] - z[j, c] - z[r, i] + z[r, c])
    return float(total)
