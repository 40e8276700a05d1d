"""Residuals of landmarks about a plane, to which the kernels of the joint map are fitted."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.data.path_error import PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.covariance.families import KernelFamily
from survey.reconstruction.gp.errors_in_variables import variance_through_slope
from survey.reconstruction.gp.selection.families import comparison, with_landforms
from survey.reconstruction.gp.selection.kernel_fit import Hyperparameters, KernelFit, stated_family
from survey.reconstruction.gp.selection.length_posterior import lengths_of
from survey.reconstruction.joint.landmark_errors import LandmarkErrors
from survey.reconstruction.joint.shared_error import SharedError

CANDIDATES: tuple[KernelFamily, ...] = ("two-scale-matern", "two-scale-mixed", "three-scale")
"""What ``family = "auto"`` chooses from: landforms are smooth, the relief underfoot is not.

The third scale is for what lies between the two, which landmarks constrain so well that two scales go to these, and gaps
between swaths would be mapped with too small a standard deviation."""

# Standard deviation of the slopes of the plane in a fit of kernels [m/m]: no ground is steeper on the whole.
_LOOSE_SLOPE = 1.0


@dataclass(frozen=True)
class PlaneResiduals:
    """Heights of landmarks about the plane of least squares, with their own and their shared errors.

    Parameters
    ----------
    points : SurfacePoints
        Landmarks.
    path : PathError
        Errors of the path that they were seen from.
    landmarks : LandmarkErrors
        Further errors that they share.
    config : GaussianProcessConfig
        Hyperparameters, or how they are found.
    """

    points: SurfacePoints
    path: PathError
    landmarks: LandmarkErrors
    config: GaussianProcessConfig

    @cached_property
    def slope(self) -> FloatArray:
        """Slope of the plane at each of the points (N, 2) [m/m]."""
        return np.tile(self._plane[1:], (len(self.points), 1))

    def candidates(self) -> list[Hyperparameters]:
        """Return the stated hyperparameters, or fits of several kernels, the likeliest first."""
        config = self.config
        if not config.fit:
            family = stated_family(config)
            return [Hyperparameters(family, config.stated_kernel(), config.nugget_m or 0.0, 0.0)]
        return with_landforms(*self._given, config, self._shared, candidates=CANDIDATES)

    def lengths(self, found: Hyperparameters) -> list[Hyperparameters]:
        """Return kernels of equally probable lengths of landforms."""
        return lengths_of(self._comparison, found)

    @property
    def _given(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        xy = self.points.xy
        return xy, self.points.z - _columns(xy) @ self._plane, own_variance(self.points, self.slope)

    @cached_property
    def _comparison(self) -> KernelFit:
        return comparison(*self._given, self.config, self._shared)

    @cached_property
    def _rows(self) -> Any:
        return SharedError.full(self.points, self.path, self.slope).rows

    def _shared(self, part: IntArray) -> FloatArray:
        common: FloatArray = self.path.covariance(self._rows[part]) + self.landmarks.covariance(part)
        return common + _of_unknown_slopes(self.points.xy[part])

    @cached_property
    def _plane(self) -> FloatArray:
        """Plane (3,) of least squares: height at the origin, slope to the east and to the north."""
        xy = self.points.xy
        middle = xy.mean(axis=0)
        level, *slope = np.linalg.lstsq(_columns(xy - middle), self.points.z, rcond=None)[0]
        return np.array([level - np.dot(slope, middle), *slope])


def own_variance(points: SurfacePoints, slope: FloatArray) -> FloatArray:
    """Return the variance (N,) of the points' own errors of height, on ground of some slope (N, 2) [m²]."""
    assert points.own_covariance is not None
    return variance_through_slope(points.own_covariance, slope)


def _of_unknown_slopes(xy: FloatArray) -> FloatArray:
    """Return the covariance (M, M) of the heights of a plane whose slopes are unknown [m²].

    The plane that is subtracted before a fit of kernels takes long relief with it; with its slopes unknown, that relief
    does not count as absent.
    """
    from_middle = _LOOSE_SLOPE * (xy - xy.mean(axis=0))
    covariance: FloatArray = from_middle @ from_middle.T
    return covariance


def _columns(xy: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(xy)), xy])
