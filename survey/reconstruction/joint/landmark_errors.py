"""Errors that landmarks share beyond those of the path, as unknowns of the joint estimate."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy import sparse

from survey.core.arrays import FloatArray, IntArray
from survey.data.shared_views import far_share, stretches
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.shared_error import bow_levers, side_by_side


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
