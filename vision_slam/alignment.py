"""Alignment of a trajectory with a reference by rotation, translation and scale."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError


@dataclass(frozen=True)
class Alignment:
    """Similarity transform x → s R x + t from one trajectory to another."""

    rotation: FloatArray
    translation: FloatArray
    scale: float

    def applied(self, position: FloatArray) -> FloatArray:
        """Apply the transform to positions (N, 3).

        Parameters
        ----------
        position : (N, 3) ndarray
            Positions [m].

        Returns
        -------
        (N, 3) ndarray
            Transformed positions [m].
        """
        moved: FloatArray = self.scale * position @ self.rotation.T + self.translation
        return moved


def alignment(
    estimate: FloatArray, reference: FloatArray, kind: Literal["none", "se3", "sim3"] = "sim3"
) -> Alignment:
    r"""Find the least-squares similarity between matched positions (N, 3) (Umeyama 1991, Eqs. 40-42).

    With Σ the covariance of reference and estimate, UDVᵀ its singular values and S the
    identity whose last entry is the sign of det(U) det(V),

    .. math:: R = U S Vᵀ, \quad s = tr(D S) / σ²_{estimate}, \quad t = μ_{reference} − s R μ_{estimate}

    ``"se3"`` sets s = 1; ``"none"`` aligns nothing.

    Parameters
    ----------
    estimate, reference : (N, 3) ndarray
        Matched positions [m].
    kind : {"none", "se3", "sim3"}
        Group of the transform.

    Returns
    -------
    Alignment
        Transform from the estimate to the reference.

    Raises
    ------
    InputError
        Different shapes, or places that are all the same or on a line, which fix no rotation.

    Examples
    --------
    >>> places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> alignment(places, 2.0 * places + 5.0).scale
    2.0
    """
    if estimate.shape != reference.shape or estimate.ndim != 2 or estimate.shape[1] != 3:
        raise InputError(
            f"places of the shapes {estimate.shape} and {reference.shape} cannot be compared; match them by time first."
        )
    if kind == "none":
        return Alignment(np.eye(3), np.zeros(3), 1.0)
    of_estimate, of_reference = estimate.mean(axis=0), reference.mean(axis=0)
    spread = estimate - of_estimate
    u, d, vt = np.linalg.svd((reference - of_reference).T @ spread / len(estimate))
    if np.count_nonzero(d > 1e-12 * max(d[0], 1e-300)) < 2:
        raise InputError("the trajectories run along a line or stand still; no rotation can be fitted.")
    mirror = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = (u * mirror) @ vt
    scale = float(d @ mirror / np.mean((spread**2).sum(axis=1))) if kind == "sim3" else 1.0
    return Alignment(rotation, of_reference - scale * rotation @ of_estimate, scale)
