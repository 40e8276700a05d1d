"""Fields of horizontal displacement between two surveys, with their covariance."""

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np

from survey.core import DataObject, FloatArray, InputError
from survey.data.ice_motion import DAY_S, IceMotion
from survey.reconstruction.motion.priors import VelocityRasters

if TYPE_CHECKING:
    from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
    from survey.scoring.differencing.tracking import TrackedMotion

# Windows of a tracked field that are used; more of them are thinned evenly.
_MOST_WINDOWS = 900
_LEAST_WINDOWS = 9
# Length scales over the extent of the windows, and errors beyond the claimed ones over the spread of the displacements.
_LENGTHS, _EXCESSES = (0.1, 0.2, 0.4, 0.8, 1.6), (0.0, 0.1, 0.3, 1.0)


class DisplacementField(Protocol):
    """Displacement of a surface from an earlier survey to a later one."""

    def shift(self, xy: FloatArray) -> FloatArray:
        """Return the displacement at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (N, 2): to the east and to the north [m].
        """
        ...

    def covariance(self, xy: FloatArray) -> FloatArray:
        """Return the covariance of the displacements at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (2, N, N): of those to the east and of those to
        the north [m²].
        """
        ...


@dataclass(frozen=True, eq=False, repr=False)
class SteadyField(DataObject):
    """Displacement by a motion that is constant in time.

    `motion`: velocity with its covariance. `days`: time between the surveys [days].
    """

    motion: IceMotion
    days: float

    def shift(self, xy: FloatArray) -> FloatArray:
        """Return the displacement at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (N, 2): to the east and to the north [m].
        """
        moved: FloatArray = self.motion.rates(xy)[:, :2] * self.days
        return moved

    def covariance(self, xy: FloatArray) -> FloatArray:
        """Return the covariance of the displacements at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (2, N, N): of those to the east and of those to
        the north [m²].
        """
        later = np.full(len(xy), self.motion.epoch_s + self.days * DAY_S)
        by = self.motion.derivatives(xy, later)[:, :2]
        covariance: FloatArray = np.einsum("nar,rs,mas->anm", by, self.motion.spread, by)
        return covariance


@dataclass(frozen=True, eq=False, repr=False)
class RasterField(DataObject):
    """Displacement by rasters of velocity, whose errors are common to all cells.

    `rasters`: velocities and their standard deviations [m/day]. `days`: time between the surveys [days].
    """

    rasters: VelocityRasters
    days: float

    def shift(self, xy: FloatArray) -> FloatArray:
        """Return the displacement at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (N, 2): to the east and to the north [m]; NaN
        where the rasters have none.
        """
        return self.days * np.column_stack([raster.at(xy) for raster in self.rasters[:2]])

    def covariance(self, xy: FloatArray) -> FloatArray:
        """Return the covariance of the displacements at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (2, N, N): of those to the east and of those to
        the north [m²].
        """
        sigma = [self.days * raster.at(xy) for raster in self.rasters[2:]]
        return np.stack([np.outer(one, one) for one in sigma])


@dataclass(frozen=True, eq=False, repr=False)
class TrackedField(DataObject):
    """Gaussian-process field through tracked displacements.

    `east`, `north`: of the displacements [m].
    """

    east: "DenseGaussianProcess"
    north: "DenseGaussianProcess"

    @classmethod
    def of(cls, tracked: "TrackedMotion") -> Self:
        """Fit a smooth field to the displacements that are not flagged."""
        good = np.flatnonzero(~tracked.is_outlier)
        if len(good) < _LEAST_WINDOWS:
            raise InputError(
                f"{len(good)} of {len(tracked)} tracked displacements are no outliers; at least {_LEAST_WINDOWS} are needed for a "
                "field, track with larger windows or a wider search."
            )
        thinned = good[np.unique(np.linspace(0, len(good) - 1, min(len(good), _MOST_WINDOWS)).astype(int))]
        xy, overlap = tracked.xy[thinned], np.sqrt(_windows_at_a_place(tracked, thinned))
        parts = zip(tracked.shift_m[thinned].T, tracked.sigma_m[thinned].T, strict=True)
        east, north = (_fitted(xy, values, sigma * overlap) for values, sigma in parts)
        return cls(east, north)

    def shift(self, xy: FloatArray) -> FloatArray:
        """Return the displacement at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (N, 2): to the east and to the north [m].
        """
        return np.column_stack([process.predict(xy)[0] for process in (self.east, self.north)])

    def covariance(self, xy: FloatArray) -> FloatArray:
        """Return the covariance of the displacements at places.

        `xy` (N, 2): places of the earlier survey [m]. Returns (2, N, N): of those to the east and of those to
        the north [m²].
        """
        return np.stack([process.joint_covariance(xy) for process in (self.east, self.north)])


def _windows_at_a_place(tracked: "TrackedMotion", used: FloatArray) -> float:
    """Return how many of the used windows cover a place, on the average; at least 1."""
    extent = np.ptp(tracked.xy[used], axis=0) + tracked.window_m
    return float(max(len(used) * tracked.window_m**2 / max(np.prod(extent), 1e-9), 1.0))


def _fitted(xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> "DenseGaussianProcess":
    """Return the process of the largest marginal likelihood among length scales and excess errors."""
    from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
    from survey.reconstruction.gp.kernels import Matern32

    spread = max(float(np.std(values)), float(np.median(sigma_m)), 1e-6)
    extent = max(float(np.ptp(xy, axis=0).max()), 1e-6)
    fits = [
        DenseGaussianProcess.fit(
            xy,
            values,
            np.hypot(sigma_m, excess * spread),
            Matern32(spread**2, length * extent),
            trend="constant",
        )
        for length, excess in product(_LENGTHS, _EXCESSES)
    ]
    return max(fits, key=lambda one: one.log_marginal_likelihood)
