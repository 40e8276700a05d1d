r"""Horizontal error of the points, by which the relief that they measure is displaced.

A path that is known to a metre displaces all that is seen from it by a metre. For landforms the error of the height is the
slope times the displacement. Relief that is shorter than the displacement is mapped at a wrong place: at given coordinates
it is noise. Where the error is normal with covariance Σ, the expected surface keeps of the variance of a wave of angular
frequency k the share

.. math::  \left| \operatorname{E} e^{i k \cdot d} \right|^2 = e^{-k^T \Sigma k}

Unknown terrain gives no information about the path: displaced relief is as probable as relief in its place. The linear
model gives some, because it takes the slopes of its own map as given: the more bumps, the smaller the stated error of the
path. Slopes of waves up to K add the information :math:`A K^4 / 16 \pi` to each coordinate where they
are resolved over an area A; K is chosen so that this stays small beside that of the path.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.path_error import POSE, PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.joint.shared_error import keyframes_of

# Largest information that slopes of the map may add to a coordinate, over that of the path.
_LARGEST_ADDED = 0.1
# Points at which the error of the path is looked at.
_MOST_PLACES = 49


@dataclass(frozen=True)
class PlaceError:
    """Horizontal error that points share with the path.

    Parameters
    ----------
    covariance_m2 : (2, 2) ndarray
        Covariance of easting and northing [m²].
    area_m2 : float
        Area of the rectangle around the points [m²].
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

        Parameters
        ----------
        omega : (..., 2) ndarray
            Angular frequencies [rad/m].

        Examples
        --------
        >>> metre = PlaceError(np.eye(2), 1e4)
        >>> metre.retained(np.array([[0.05, 0.0], [1.0, 0.0], [3.0, 0.0]])).round(3)
        array([1.   , 0.368, 0.   ])
        """
        share = np.exp(-np.einsum("...i,ij,...j->...", omega, self.covariance_m2, omega))
        return np.where(np.linalg.norm(omega, axis=-1) <= self.highest_rad_per_m, 1.0, share)
