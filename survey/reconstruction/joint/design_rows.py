"""Design matrices of the joint estimate: rows of the points and of the prior's cells for all shared unknowns."""

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from survey.core.arrays import FloatArray
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.noisy_values import NoisyValues
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend
from survey.reconstruction.joint.joint_solve import Functionals
from survey.reconstruction.joint.landmark_errors import LandmarkErrors
from survey.reconstruction.joint.satellite_cells import SatelliteCells
from survey.reconstruction.joint.shared_error import SharedError, side_by_side


class JointSystem(NamedTuple):
    """Points, waves and shared unknowns of the joint estimate, before it is solved.

    ``strengths`` (K,) are the waves' prior standard deviations [m]; ``noise_m2`` (N,) the points' own variances, and
    ``total_m2`` (N,) those with relief that the waves leave out. ``data`` are the heights above ``datum_m`` with the
    latter; ``rows`` (N, S) and ``information`` (S, S), sparse, are those of `point_rows`.
    """

    shared: SharedError
    landmarks: LandmarkErrors
    basis: FourierBasis
    strengths: FloatArray
    trend: PolynomialTrend
    tail_m2: float
    datum_m: float
    noise_m2: FloatArray
    total_m2: FloatArray
    data: NoisyValues
    rows: Any
    information: Any


def point_rows(
    points: SurfacePoints,
    shared: SharedError,
    trend: PolynomialTrend,
    landmarks: LandmarkErrors,
    cells: SatelliteCells | None,
) -> tuple[Any, Any]:
    """Return the derivatives (N, S) of the points' heights by all shared unknowns, and their prior information (S, S).

    The unknowns are the path's errors, the plane, the landmarks' errors and the cells' common errors, in this order.
    """
    columns = trend.columns(points.xy)
    n_common = 0 if cells is None else len(cells.common)
    rows = side_by_side(shared.rows, columns, landmarks.rows, sparse.csr_array((len(points), n_common)))
    return rows, _with_more(shared.information, columns.shape[1], landmarks.sigma, cells)


def cell_rows(
    cells: SatelliteCells,
    trend: PolynomialTrend,
    waves: FloatArray,
    datum_m: float,
    n_others: tuple[int, int],
) -> Functionals:
    """Return the cells as rows: their waves, the plane at their centres, their common errors; nothing of path and landmarks."""
    n_path, n_landmarks = n_others
    nothing = [sparse.csr_array((len(cells), n)) for n in (n_path, n_landmarks)]
    rows = side_by_side(nothing[0], trend.columns(cells.centre), nothing[1], cells.common_rows)
    return Functionals(waves, rows, cells.height - datum_m, cells.covariance)


def _with_more(information: Any, n_plane: int, landmarks: FloatArray, cells: SatelliteCells | None) -> Any:
    """Return the prior information with that of the plane, which is none, of the landmarks' and of the cells' common errors."""
    own = np.r_[np.zeros(n_plane), landmarks**-2.0]
    if cells is not None:
        own = np.r_[own, cells.common_sigma**-2.0]
    blocks: Any = [information, sparse.diags_array(own)]
    return sparse.csr_array(sparse.block_diag(blocks))
