"""Stencils of a lattice, compiled: the prior's, the data's, and their product with a vector without a matrix.

The prior of thin plate, membrane and mass comes first, with free edges. `apply` multiplies the operator of data and prior
with heights, `prior_diagonal` and `lumped` give what a smoother needs, and `prior_noise` draws from the prior.
`add_points` sums points into the data's stencil, its right-hand side, the draws and the moments.

Arrays are (rows, columns) with the row counting northwards and the column eastwards. The data
stencil holds, for every node, its own weight and the couplings to its neighbours in the
east, north, north-east and north-west; the others follow by symmetry. Sums are not reordered
(no fast math): the same map has the same bytes whatever was compiled before it.
"""

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core import FloatArray

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


OWN, EAST, NORTH, NORTH_EAST, NORTH_WEST = range(5)


@njit(cache=True, inline="always")
def _add_data_row(stencil: FloatArray, z: FloatArray, j: int, out: FloatArray) -> None:
    """Add the data's couplings of row j with itself and its neighbours."""
    rows, columns = z.shape
    row, into = z[j], out[j]
    own, east = stencil[0, j], stencil[1, j]
    into[0] += own[0] * row[0] + east[0] * row[1]
    for i in range(1, columns - 1):
        into[i] += own[i] * row[i] + east[i] * row[i + 1] + east[i - 1] * row[i - 1]
    into[columns - 1] += own[columns - 1] * row[columns - 1] + east[columns - 2] * row[columns - 2]
    if j < rows - 1:
        north, up, up_right, up_left = z[j + 1], stencil[2, j], stencil[3, j], stencil[4, j]
        into[0] += up[0] * north[0] + up_right[0] * north[1]
        for i in range(1, columns - 1):
            into[i] += up[i] * north[i] + up_right[i] * north[i + 1] + up_left[i] * north[i - 1]
        into[columns - 1] += up[columns - 1] * north[columns - 1] + up_left[columns - 1] * north[columns - 2]
    if j > 0:
        south, down, down_left, down_right = z[j - 1], stencil[2, j - 1], stencil[3, j - 1], stencil[4, j - 1]
        into[0] += down[0] * south[0] + down_right[1] * south[1]
        for i in range(1, columns - 1):
            into[i] += down[i] * south[i] + down_left[i - 1] * south[i - 1] + down_right[i + 1] * south[i + 1]
        into[columns - 1] += (
            down[columns - 1] * south[columns - 1] + down_left[columns - 2] * south[columns - 2]
        )


@njit(cache=True)
def _add_membrane_row(membrane: float, z: FloatArray, j: int, out: FloatArray) -> None:
    """Add what springs between neighbours pull on row j."""
    rows, columns = z.shape
    row = out[j]
    for i in range(columns - 1):
        row[i] -= membrane * (z[j, i + 1] - z[j, i])
    for i in range(1, columns):
        row[i] += membrane * (z[j, i] - z[j, i - 1])
    if j < rows - 1:
        for i in range(columns):
            row[i] -= membrane * (z[j + 1, i] - z[j, i])
    if j > 0:
        for i in range(columns):
            row[i] += membrane * (z[j, i] - z[j - 1, i])


@njit(cache=True)
def _bend_along(plate: float, soft: FloatArray, z: FloatArray, j: int, into: FloatArray) -> None:
    """Fill into[2:-2] with the moments of the east-west curvature along row j; none at the ends."""
    columns = z.shape[1]
    for i in range(1, columns - 1):
        into[i + 1] = plate * (z[j, i - 1] - 2.0 * z[j, i] + z[j, i + 1])
    if soft.shape[0]:
        for i in range(1, columns - 1):
            into[i + 1] *= soft[0, j, i]


@njit(cache=True)
def _bend_across(plate: float, soft: FloatArray, z: FloatArray, j: int, into: FloatArray) -> None:
    """Fill a row with the moments of the north-south curvature at row j; none on the first and last row."""
    rows, columns = z.shape
    if j < 1 or j > rows - 2:
        for i in range(columns):
            into[i] = 0.0
        return
    for i in range(columns):
        into[i] = plate * (z[j - 1, i] - 2.0 * z[j, i] + z[j + 1, i])
    if soft.shape[0]:
        for i in range(columns):
            into[i] *= soft[1, j, i]


@njit(cache=True)
def _twist(plate: float, soft: FloatArray, z: FloatArray, j: int, into: FloatArray) -> None:
    """Fill into[1:] with the moments of the twist of the cells between rows j and j + 1; none beyond the ends."""
    rows, columns = z.shape
    for i in range(columns + 1):
        into[i] = 0.0
    if j < 0 or j > rows - 2:
        return
    for i in range(columns - 1):
        into[i + 1] = 2.0 * plate * (z[j, i] - z[j, i + 1] - z[j + 1, i] + z[j + 1, i + 1])
    if soft.shape[0]:
        for i in range(columns - 1):
            into[i + 1] *= soft[2, j, i]


@njit(cache=True)
def apply(stencil: FloatArray, weights: Weights, soft: FloatArray, z: FloatArray, out: FloatArray) -> None:
    """Set ``out = (data + plate · thin plate + membrane · springs + mass) z``, boundaries free.

    `stencil` has five layers, or one when the data hang on single nodes; `soft` has three
    layers of factors on the curvatures (east, north, twist), or none.
    """
    rows, columns = z.shape
    if soft.shape[0] or rows < 5 or columns < 5:
        _apply_by_bends(stencil, weights, soft, z, out)
        return
    prior_of_edge_rows(weights, z, out)
    for j in range(rows):
        if 2 <= j < rows - 2:
            prior_of_inner_row(weights, z, j, out)
            prior_of_row_ends(weights, z, j, out)
        else:
            for i in (0, 1, columns - 2, columns - 1):
                out[j, i] = prior_at_node(weights, z, j, i)
        if stencil.shape[0] == 1:
            for i in range(columns):
                out[j, i] += stencil[0, j, i] * z[j, i]
        else:
            _add_data_row(stencil, z, j, out)


@njit(cache=True)
def _apply_by_bends(
    stencil: FloatArray, weights: Weights, soft: FloatArray, z: FloatArray, out: FloatArray
) -> None:
    """Do the same in one sweep over all bends, each with its factor, on a lattice of any size."""
    plate, membrane, mass = weights
    rows, columns = z.shape
    along = np.zeros(columns + 2)
    twist_south, twist_north = np.zeros(columns + 1), np.zeros(columns + 1)
    south, here, north = np.zeros(columns), np.zeros(columns), np.zeros(columns)
    if plate > 0:
        _bend_across(plate, soft, z, 1, north)
    for j in range(rows):
        row = out[j]
        for i in range(columns):
            row[i] = mass * z[j, i]
        if stencil.shape[0] == 1:
            for i in range(columns):
                row[i] += stencil[0, j, i] * z[j, i]
        else:
            _add_data_row(stencil, z, j, out)
        if membrane > 0:
            _add_membrane_row(membrane, z, j, out)
        if plate > 0:
            _bend_along(plate, soft, z, j, along)
            _twist(plate, soft, z, j, twist_north)
            for i in range(columns):
                row[i] += along[i] - 2.0 * along[i + 1] + along[i + 2]
            for i in range(columns):
                row[i] += south[i] - 2.0 * here[i] + north[i]
            for i in range(columns):
                row[i] += twist_north[i + 1] - twist_north[i] - twist_south[i + 1] + twist_south[i]
            south, here, north = here, north, south
            twist_south, twist_north = twist_north, twist_south
            _bend_across(plate, soft, z, j + 2, north)


@njit(cache=True)
def prior_diagonal(weights: Weights, soft: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return the diagonal of the operator without data."""
    plate, membrane, mass = weights
    rows, columns = shape
    diagonal = np.full(shape, mass)
    weighted = soft.shape[0] > 0
    for j in range(rows):
        for i in range(columns):
            neighbours = (i > 0) + (i < columns - 1) + (j > 0) + (j < rows - 1)
            diagonal[j, i] += membrane * neighbours
            if 0 < i < columns - 1:
                w = plate * (soft[0, j, i] if weighted else 1.0)
                diagonal[j, i - 1] += w
                diagonal[j, i] += 4.0 * w
                diagonal[j, i + 1] += w
            if 0 < j < rows - 1:
                w = plate * (soft[1, j, i] if weighted else 1.0)
                diagonal[j - 1, i] += w
                diagonal[j, i] += 4.0 * w
                diagonal[j + 1, i] += w
            if i < columns - 1 and j < rows - 1:
                w = 2.0 * plate * (soft[2, j, i] if weighted else 1.0)
                diagonal[j, i] += w
                diagonal[j, i + 1] += w
                diagonal[j + 1, i] += w
                diagonal[j + 1, i + 1] += w
    return diagonal


@njit(cache=True)
def prior_noise(weights: Weights, soft: FloatArray, normals: FloatArray, out: FloatArray) -> None:
    """Add noise to `out` whose covariance is the operator without data; `normals` is (6, rows, columns)."""
    plate, membrane, mass = weights
    rows, columns = out.shape
    weighted = soft.shape[0] > 0
    root, spring = np.sqrt(plate), np.sqrt(membrane)
    for j in range(rows):
        for i in range(columns):
            out[j, i] += np.sqrt(mass) * normals[0, j, i]
            if i < columns - 1:
                out[j, i] -= spring * normals[1, j, i]
                out[j, i + 1] += spring * normals[1, j, i]
            if j < rows - 1:
                out[j, i] -= spring * normals[2, j, i]
                out[j + 1, i] += spring * normals[2, j, i]
            if 0 < i < columns - 1:
                e = root * normals[3, j, i] * (np.sqrt(soft[0, j, i]) if weighted else 1.0)
                out[j, i - 1] += e
                out[j, i] -= 2.0 * e
                out[j, i + 1] += e
            if 0 < j < rows - 1:
                e = root * normals[4, j, i] * (np.sqrt(soft[1, j, i]) if weighted else 1.0)
                out[j - 1, i] += e
                out[j, i] -= 2.0 * e
                out[j + 1, i] += e
            if i < columns - 1 and j < rows - 1:
                e = np.sqrt(2.0) * root * normals[5, j, i] * (np.sqrt(soft[2, j, i]) if weighted else 1.0)
                out[j, i] += e
                out[j, i + 1] -= e
                out[j + 1, i] -= e
                out[j + 1, i + 1] += e


@njit(cache=True)
def lumped(stencil: FloatArray) -> FloatArray:
    """Return the sum of each node's row of the data stencil (all its couplings are positive)."""
    rows, columns = stencil.shape[1:]
    total: FloatArray = stencil[0].copy()
    if stencil.shape[0] == 1:
        return total
    for j in range(rows):
        for i in range(columns):
            if i < columns - 1:
                total[j, i] += stencil[1, j, i]
                total[j, i + 1] += stencil[1, j, i]
            if j < rows - 1:
                total[j, i] += stencil[2, j, i]
                total[j + 1, i] += stencil[2, j, i]
            if i < columns - 1 and j < rows - 1:
                total[j, i] += stencil[3, j, i]
                total[j + 1, i + 1] += stencil[3, j, i]
            if i > 0 and j < rows - 1:
                total[j, i] += stencil[4, j, i]
                total[j + 1, i - 1] += stencil[4, j, i]
    return total


Draws = npt.NDArray[np.float32]


@njit(cache=True, inline="always")
def _hashed(key: np.uint64) -> np.uint64:
    """Return 64 well-mixed bits (the finaliser of SplitMix64)."""
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


@njit(cache=True)
def add_points(
    points: FloatArray, stencil: FloatArray, rhs: FloatArray, draws: Draws, first_number: int
) -> int:
    """Add points to stencil and right-hand side; return how many lay on the lattice.

    The columns of `points` (N, 4) are the lattice coordinates u (east) and v (north), the
    height [m] and the weight [1/m²]. Every draw gets each point's error with a random sign,
    so that over the draws its covariance is that of the measurements.
    """
    rows, columns = rhs.shape
    n_draws = draws.shape[2]
    signs = np.empty(n_draws, dtype=np.float32)
    n_inside = 0
    for k in range(len(points)):
        u, v, z, w = points[k]
        i, j = int(np.floor(u)), int(np.floor(v))
        # A point on the last row or column belongs to the cell before it.
        i -= i == columns - 1 and u == i
        j -= j == rows - 1 and v == j
        if i < 0 or j < 0 or i >= columns - 1 or j >= rows - 1:
            continue
        n_inside += 1
        s, t = u - i, v - j
        sw, se, nw, ne = (1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t
        wz = w * z
        stencil[0, j, i] += w * sw * sw
        stencil[0, j, i + 1] += w * se * se
        stencil[0, j + 1, i] += w * nw * nw
        stencil[0, j + 1, i + 1] += w * ne * ne
        stencil[1, j, i] += w * sw * se
        stencil[1, j + 1, i] += w * nw * ne
        stencil[2, j, i] += w * sw * nw
        stencil[2, j, i + 1] += w * se * ne
        stencil[3, j, i] += w * sw * ne
        stencil[4, j, i + 1] += w * se * nw
        rhs[j, i] += wz * sw
        rhs[j, i + 1] += wz * se
        rhs[j + 1, i] += wz * nw
        rhs[j + 1, i + 1] += wz * ne
        if n_draws:
            bits = _hashed(np.uint64(first_number + k) * np.uint64(0x9E3779B97F4A7C15))
            root = np.float32(np.sqrt(w))
            for d in range(n_draws):
                if d % 64 == 0 and d > 0:
                    bits = _hashed(bits)
                signs[d] = root if (bits >> np.uint64(d % 64)) & np.uint64(1) else -root
            a, b, c, e = np.float32(sw), np.float32(se), np.float32(nw), np.float32(ne)
            for d in range(n_draws):
                draws[j, i, d] += a * signs[d]
                draws[j, i + 1, d] += b * signs[d]
                draws[j + 1, i, d] += c * signs[d]
                draws[j + 1, i + 1, d] += e * signs[d]
    return n_inside


@njit(cache=True)
def add_moments(points: FloatArray, moments: FloatArray) -> None:
    """Add Σ w t tᵀ and Σ w t z, with t = (1, u, v), to `moments` (3, 4)."""
    for k in range(len(points)):
        u, v, z, w = points[k]
        for a, left in enumerate((w, w * u, w * v)):
            moments[a, 0] += left
            moments[a, 1] += left * u
            moments[a, 2] += left * v
            moments[a, 3] += left * z


@njit(cache=True)
def add_moments_of_sums(stencil: FloatArray, rhs: FloatArray, moments: FloatArray) -> None:
    """Add to `moments` what `add_moments` would have, from the sums over the points: Tᵀ S T and Tᵀ b."""
    rows, columns = rhs.shape
    steps = ((0, 0), (1, 0), (0, 1), (1, 1), (-1, 1))
    for j in range(rows):
        for i in range(columns):
            moments[0, 3] += rhs[j, i]
            moments[1, 3] += rhs[j, i] * i
            moments[2, 3] += rhs[j, i] * j
            for layer in range(5):
                w = stencil[layer, j, i]
                if w == 0.0:
                    continue
                east, north = steps[layer]
                u, v = i + east, j + north
                # A coupling stands for two entries of the matrix, one on either side of its diagonal.
                half = 0.5 * w if layer == 0 else w
                moments[0, 0] += 2.0 * half
                moments[0, 1] += half * (i + u)
                moments[0, 2] += half * (j + v)
                moments[1, 1] += 2.0 * half * i * u
                moments[1, 2] += half * (i * v + j * u)
                moments[2, 2] += 2.0 * half * j * v
    moments[1, 0], moments[2, 0], moments[2, 1] = moments[0, 1], moments[0, 2], moments[1, 2]
