r"""Errors that points share: of the path, of the landmarks, of their places, and relief finer than the map.

`SharedError` holds the derivatives of the points' heights by the errors of the path's poses, or by their dominant modes.
`LandmarkErrors` are unknowns beyond the path: bowing of each camera, bias of far landmarks, an error of each stretch.

`PlaceError` is the horizontal error of the path, by which the relief that points measure is displaced. For landforms the error
of the height is the slope times the displacement. Shorter relief is mapped at a wrong place: at given coordinates it is
noise. Where the error is normal with covariance Σ, the expected surface keeps of the variance of a wave of angular
frequency k the share

.. math::  \left| \operatorname{E} e^{i k \cdot d} \right|^2 = e^{-k^T \Sigma k}

Unknown terrain gives no information about the path: displaced relief is as probable as relief in its place. The linear
model gives some, because it takes the slopes of its own map as given. Slopes of waves up to K add the information
:math:`A K^4 / 16 \pi` to each coordinate where they are resolved over an area A; K is chosen so that this stays small beside
that of the path.

`with_shared_relief` adds the relief of waves that the map leaves out to the noise of the points. Points a metre apart share
it: as independent noise, a hundred of them would average it away, and slopes across a swath would be too certain.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy import fft, sparse
from scipy.sparse.linalg import LinearOperator, eigsh

from survey.core import FloatArray, InputError, IntArray
from survey.data import SurfacePoints
from survey.data.landmarks import far_share, stretches
from survey.data.path_error import POSE, PathError
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.kernels import Kernel

# A slope and an arm that bring the unknowns of a pose to one unit, metres of height, before modes are compared.
_TYPICAL_SLOPE, _TYPICAL_ARM_M = 0.06, 12.0


@dataclass(frozen=True)
class SharedError:
    """Unknowns that points share: ``rows`` (N, S) of a point's height, prior ``information`` (S, S), both sparse.

    ``rest_m2`` (N,) is what the rows leave out, as if it were each point's own, and
    ``poses`` (6 K, S) leads back to the error of each keyframe's pose.
    """

    rows: Any
    information: Any
    rest_m2: FloatArray
    poses: Any

    @classmethod
    def full(cls, points: SurfacePoints, path: PathError, slope: FloatArray) -> "SharedError":
        """Keep every unknown of the path."""
        keyframe, by_pose = _levers(points, slope)
        rest = np.zeros(len(points))
        return cls(path.rows(keyframe, by_pose), path.information, rest, _every_pose(path))

    @classmethod
    def dominant(
        cls, points: SurfacePoints, path: PathError, slope: FloatArray, modes: FloatArray
    ) -> "SharedError":
        """Keep a few modes of the path's error, as `dominant_modes` gives them; the rest becomes the points' own."""
        keyframe, by_pose = _levers(points, slope)
        rows = path.rows(keyframe, by_pose)
        kept = np.asarray(rows @ modes)
        total = np.einsum("ni,nij,nj->n", by_pose, path.pose_covariance(keyframe), by_pose)
        rest = np.maximum(total - np.sum(kept**2, axis=1), 0.0)
        unit = sparse.identity(modes.shape[1], format="csr")
        return cls(sparse.csr_array(kept), unit, rest, sparse.csr_array(_every_pose(path) @ modes))


def dominant_modes(path: PathError, rank: int) -> FloatArray:
    """Return V (unknowns, r) with V Vᵀ close to the covariance of the poses' errors, where it matters for heights."""
    scale = np.array([_TYPICAL_SLOPE] * 2 + [1.0, _TYPICAL_SLOPE * _TYPICAL_ARM_M] + [_TYPICAL_ARM_M] * 2)
    scales = np.tile(scale, len(path))
    poses = _every_pose(path)
    rank = min(rank, len(scales) - 1)

    def product(vector: FloatArray) -> FloatArray:
        scaled: FloatArray = scales * (poses @ path.solve(poses.T @ (scales * vector.ravel())))
        return scaled

    size = len(scales)
    operator = LinearOperator((size, size), matvec=product, dtype=np.float64)
    value, vector = eigsh(operator, k=rank, v0=np.ones(size))
    modes: FloatArray = poses.T @ ((vector * np.sqrt(np.maximum(value, 0.0))) / scales[:, None])
    return modes


def height_levers(points: SurfacePoints, slope: FloatArray) -> FloatArray:
    r"""Return how a point's height above the map answers to errors of its pose (N, 6).

    A point reported at the arm (x, y, z) from a pose that errs by (e, ψ, θ, φ) errs by
    e + ∂(R o)/∂(ψ, θ, φ), and lies higher above a surface of slope g by the vertical part
    less g times the horizontal one. Heading and arm give the levers: across the heading
    for roll, along it for pitch.
    """
    (x, y, z), heading = _arms(points)
    cosine, sine = np.cos(heading), np.sin(heading)
    above = np.column_stack([-slope, np.ones(len(slope))])
    by_yaw = np.column_stack([-y, x, np.zeros_like(x)])
    by_pitch = np.column_stack([cosine * z, sine * z, -(cosine * x + sine * y)])
    by_roll = np.column_stack([sine * z, -cosine * z, cosine * y - sine * x])
    turns = [np.einsum("ni,ni->n", above, by) for by in (by_yaw, by_pitch, by_roll)]
    return np.column_stack([above, *turns])


def bow_levers(points: SurfacePoints) -> FloatArray:
    """Return how far ahead of its pose each point lies, and how far aside, to either side (N, 2) [m].

    What a camera sees may lie too high or too low by a share of either, on all of a drive alike: lens and
    mounting are never known exactly. Swaths then look like ridges, and the gaps between them like valleys.
    """
    (x, y, _), heading = _arms(points)
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.column_stack([cosine * x + sine * y, np.abs(cosine * y - sine * x)])


def side_by_side(*blocks: Any) -> Any:
    """Return matrices of as many rows, sparse or not, as one sparse one."""
    parts: Any = blocks
    return sparse.csr_array(sparse.hstack(parts))


def _arms(points: SurfacePoints) -> tuple[FloatArray, FloatArray]:
    """Return the vectors (3, N) from the body to the points [m], and the body's headings (N,) [rad]."""
    if points.body is None or points.heading_rad is None:
        raise InputError(
            "the points do not state place and heading of the body that they were seen from; localize again, "
            "or map them as independent."
        )
    return (points.xyz - points.body).T, points.heading_rad


def keyframes_of(points: SurfacePoints) -> FloatArray:
    """Return where among the keyframes of the path the points (N,) were seen from; refuse points that do not name them."""
    if points.keyframe is None:
        raise InputError(
            "the points do not name the keyframes that they were seen from; localize again, or map them as independent."
        )
    return points.keyframe


def _levers(points: SurfacePoints, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    return keyframes_of(points), height_levers(points, slope)


def _every_pose(path: PathError) -> Any:
    """Return the rows (6 K, unknowns) of the errors of all keyframes' poses."""
    keyframe = np.repeat(np.arange(len(path), dtype=np.float64), POSE)
    return path.rows(keyframe, np.tile(np.eye(POSE), (len(path), 1)))


@dataclass(frozen=True)
class LandmarkErrors:
    """Unknowns of the landmarks' heights: bowing of each rover's camera, bias of far ones, error of each stretch of travel.

    ``rows`` (N, k), sparse, are the derivatives of the heights by the unknowns, whose prior standard deviations are
    ``sigma`` (k,); ``names`` are those of the first ones, which all landmarks of a drive or of all drives share.
    """

    rows: Any
    sigma: FloatArray
    names: tuple[str, ...]

    @classmethod
    def of(cls, points: SurfacePoints, joint: JointConfig, drive: IntArray | None = None) -> Self:
        """Return the unknowns that the settings ask for; `drive` (N,) are the points' drives, 0 by default."""
        drives = np.zeros(len(points), dtype=np.int64) if drive is None else drive
        blocks: list[Any] = [sparse.csr_array((len(points), 0))]
        names, sigma = list[str](), list[float]()
        if joint.bow_sigma_deg > 0.0:
            levers, n_drives = bow_levers(points), int(drives.max()) + 1
            blocks += [levers * (drives == k)[:, None] for k in range(n_drives)]
            names += _bow_names(n_drives)
            sigma += [float(np.radians(joint.bow_sigma_deg))] * (2 * n_drives)
        if joint.far_bias_sigma_m > 0.0 and points.range_m is not None:
            blocks.append(far_share(points.range_m)[:, None])
            names.append("far_bias_m")
            sigma.append(joint.far_bias_sigma_m)
        numbers = stretches(points, drives)
        if joint.landmark_shared_sigma_m > 0.0 and numbers is not None:
            blocks.append(_one_of(numbers))
            sigma += [joint.landmark_shared_sigma_m] * blocks[-1].shape[1]
        return cls(side_by_side(*blocks), np.array(sigma), tuple(names))

    def covariance(self, part: IntArray) -> FloatArray:
        """Return the prior covariance (M, M) of the heights of some landmarks by these errors [m²]."""
        scaled = self.rows[part] @ sparse.diags_array(self.sigma)
        covariance: FloatArray = (scaled @ scaled.T).toarray()
        return covariance


def _bow_names(n_drives: int) -> list[str]:
    """Return the names of the bowing of each camera; that of a single drive has no number."""
    drives = [""] if n_drives == 1 else [f"drive_{k + 1}_" for k in range(n_drives)]
    return [f"{drive}{name}" for drive in drives for name in ("bow_ahead_rad", "bow_aside_rad")]


def _one_of(numbers: IntArray) -> Any:
    """Return sparse rows (N, K) with a 1 in the column of each number."""
    shape = len(numbers), int(numbers.max()) + 1
    return sparse.csr_array((np.ones(len(numbers)), (np.arange(len(numbers)), numbers)), shape=shape)


# Largest information that slopes of the map may add to a coordinate, over that of the path.
_LARGEST_ADDED = 0.1
# Points at which the error of the path is looked at.
_MOST_PLACES = 49


@dataclass(frozen=True)
class PlaceError:
    """Horizontal error that points share with the path.

    `covariance_m2` (2, 2): covariance of easting and northing [m²]. `area_m2`: area of the rectangle around
    the points [m²].
    """

    covariance_m2: FloatArray
    area_m2: float

    @classmethod
    def of(cls, points: SurfacePoints, path: PathError) -> Self:
        """Return the error of the path at the point that has the median of all variances."""
        every = np.sort(keyframes_of(points))
        n = min(len(every), _MOST_PLACES)
        keyframe = every[np.linspace(0, len(every) - 1, n).astype(np.int64)]
        rows = path.rows(np.repeat(keyframe, 2), np.tile(np.eye(POSE)[:2], (n, 1)))
        together = path.covariance(rows).reshape(n, 2, n, 2)
        places = together[np.arange(n), :, np.arange(n), :]
        by_size = np.argsort(np.trace(places, axis1=1, axis2=2), kind="stable")
        return cls(places[by_size[n // 2]], float(np.prod(np.ptp(points.xy, axis=0))))

    @property
    def highest_rad_per_m(self) -> float:
        """Angular frequency K of the shortest waves whose slopes count [rad/m]; infinite without an error or an area."""
        uncertain = 0.5 * float(np.trace(self.covariance_m2)) * self.area_m2
        return float((16.0 * np.pi * _LARGEST_ADDED / uncertain) ** 0.25) if uncertain > 0.0 else np.inf

    def retained(self, omega: FloatArray) -> FloatArray:
        """Return the share (...) of the variance of waves that is mapped, from 0 to 1.

        Waves whose slopes count keep all of it: the linear model has their error.

        `omega` (..., 2): angular frequencies [rad/m].

        >>> metre = PlaceError(np.eye(2), 1e4)
        >>> metre.retained(np.array([[0.05, 0.0], [1.0, 0.0], [3.0, 0.0]])).round(3)
        array([1.   , 0.368, 0.   ])
        """
        share = np.exp(-np.einsum("...i,ij,...j->...", omega, self.covariance_m2, omega))
        return np.where(np.linalg.norm(omega, axis=-1) <= self.highest_rad_per_m, 1.0, share)


# Cells per length scale, and how many there may be along a side: beyond that points of one cell count as one place.
_PER_LENGTH, _MOST_CELLS = 2.5, 1500.0
# Points at opposite edges must not meet around the back of the periodic grid.
_MARGIN_LENGTHS, _MARGIN_M = 20.0, 20.0


def with_shared_relief(
    xy: FloatArray,
    noise_m2: FloatArray,
    kernel: Kernel,
    basis: FourierBasis,
    tail_m2: float,
    *,
    retained: Callable[[FloatArray], FloatArray] | None = None,
) -> FloatArray:
    r"""Return noise variances (N,) [m²] of points that amount to their own noise and the relief between them.

    With own variances d and the covariance t of the relief that the waves leave out, n points
    of one place determine it with the variance ``1 / Σ 1/d + t``. Independent variances

    .. math::  D_i = d_i \left( 1 + \sum_j t(x_i - x_j) / d_j \right)

    give the same, and the same weights among them; points apart from each other keep ``d + t(0)``,
    which is the least anywhere. The sum is a convolution on a grid.

    `xy` (N, 2): places [m]. `noise_m2` (N,): the points' own variances, positive [m²]. `tail_m2`: variance of
    the others [m²], and of what the retained waves leave out. `retained`: returns the share of the variance
    of waves of angular frequencies (..., 2) [rad/m] that the map has; all by default.

    >>> from survey.reconstruction.gp.engines.fourier_basis import FourierBox
    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> box = FourierBox.around((0.0, 0.0, 100.0, 100.0), 20.0)
    >>> none = FourierBasis.of(box, np.zeros((1, 2), dtype=np.int64))
    >>> relief = SquaredExponential(0.01, 3.0)
    >>> xy = np.array([[20.0, 50.0], [20.0, 50.0], [80.0, 50.0]])
    >>> with_shared_relief(xy, np.full(3, 0.04), relief, none, 0.01).round(3)
    array([0.06, 0.06, 0.05])
    """
    length_m, extent_m = kernel.length_scales_m[0], np.ptp(xy, axis=0)
    step_m = max(length_m / _PER_LENGTH, float(extent_m.max()) / _MOST_CELLS)
    margin_m = _MARGIN_LENGTHS * length_m + _MARGIN_M
    shape = [fft.next_fast_len(int(side / step_m) + 1, real=True) for side in (extent_m + margin_m).tolist()]
    spectrum = _spectrum_left_out(kernel, basis, shape, step_m, retained)
    variance_m2 = float(fft.irfft2(spectrum, shape)[0, 0])
    if variance_m2 <= 0.0:  # waves shorter than the grid's cells: no two points share them
        return noise_m2 + tail_m2
    spectrum *= tail_m2 / variance_m2
    cell = np.rint((xy - xy.min(axis=0)) / step_m).astype(np.int64)
    weight = np.zeros(shape)
    np.add.at(weight, (cell[:, 0], cell[:, 1]), 1.0 / noise_m2)
    shared = fft.irfft2(fft.rfft2(weight) * spectrum, shape)[cell[:, 0], cell[:, 1]]
    result: FloatArray = noise_m2 + np.maximum(noise_m2 * shared, tail_m2)
    return result


def _spectrum_left_out(
    kernel: Kernel,
    basis: FourierBasis,
    shape: list[int],
    step_m: float,
    retained: Callable[[FloatArray], FloatArray] | None,
) -> FloatArray:
    """Return the spectral density of relief that the waves leave out, as `scipy.fft.rfft2` orders it."""
    along_x = 2.0 * np.pi * fft.fftfreq(shape[0], step_m)
    along_y = 2.0 * np.pi * fft.rfftfreq(shape[1], step_m)
    omega = np.stack(np.meshgrid(along_x, along_y, indexing="ij"), axis=-1)
    density = kernel.spectral_density(omega)
    weakest = float(kernel.spectral_density(basis.omega).min())
    rest = 0.0 if retained is None else density * (1.0 - retained(omega))
    return np.where(density < weakest * (1.0 - 1e-9), density, rest)
