"""Relief of the waves that the fast engine leaves out, as the nearest points know it."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import trapezoid
from scipy.spatial import cKDTree
from scipy.special import j0

from survey.arrays import FloatArray
from survey.reconstruction.gaussian_process import FourierGaussianProcess
from survey.reconstruction.process import Process

_N_NEIGHBOURS = 4
_N_FREQUENCIES, _N_DISTANCES = 3000, 300
_BLOCK = 20_000


@dataclass(frozen=True)
class FineRelief:
    r"""Covariance of the waves left out, and what the four nearest points explain of them.

    The engine counts the variance τ of the waves that it leaves out as noise of no extent,
    which is too cautious beside a point. Their covariance is

    .. math::  k_t(r) = \frac{1}{2 \pi} \int_{\omega_c}^\infty S(\omega) J_0(\omega r) \omega \, d\omega

    beyond the cut ω_c, and at a place the nearest points, whose errors are their own noise
    and what the kept waves leave open, explain ``kᵀ (K_t + N + V)⁻¹ k`` of τ.

    Notes
    -----
    Isotropic kernels only. Errors of the kept waves are taken as independent between
    neighbours, which they are not quite: a few per cent of what is explained.
    """

    xy: FloatArray
    noise_m2: FloatArray
    distance_m: FloatArray
    covariance_m2: FloatArray

    @classmethod
    def of(cls, process: Process) -> "FineRelief | None":
        """Return it for a process that leaves waves out, and None for any other."""
        if not isinstance(process, FourierGaussianProcess) or process.resolution.is_met:
            return None
        if process.kernel.length_scales_m[0] <= 0.0 or not _is_isotropic(process):
            return None
        tail = process.resolution.tail_m2
        cut = float(np.hypot(*process.resolution.covariance_basis.omega.T).max())
        omega = np.geomspace(cut, max(60.0 / process.kernel.length_scales_m[0], 4.0 * cut), _N_FREQUENCIES)
        density = process.kernel.spectral_density(np.column_stack([omega, np.zeros_like(omega)]))
        distance = np.linspace(0.0, 3.0 * 2.0 * np.pi / cut, _N_DISTANCES)
        covariance = trapezoid(j0(np.outer(distance, omega)) * density * omega, omega, axis=1)
        left_open = np.maximum(process.predict(process.data.xy)[1] - tail, 0.0)
        return cls(
            process.data.xy,
            process.data.noise_m2 + left_open,
            distance,
            tail * covariance / covariance[0],
        )

    def explained(self, xy: FloatArray) -> FloatArray:
        """Return the variance (M,) that the nearest points explain at places (M, 2) [m²]."""
        tree = cKDTree(self.xy)
        blocks = [self._explained(xy[k : k + _BLOCK], tree) for k in range(0, len(xy), _BLOCK)]
        return np.concatenate(blocks) if blocks else np.zeros(0)

    def _explained(self, xy: FloatArray, tree: cKDTree) -> FloatArray:
        n = min(_N_NEIGHBOURS, len(self.xy))
        found, rows = tree.query(xy, k=n)
        distance = np.asarray(found, dtype=np.float64).reshape(len(xy), n)
        index = np.asarray(rows).reshape(len(xy), n)
        near = self.xy[index]
        apart = np.linalg.norm(near[:, :, None, :] - near[:, None, :, :], axis=-1)
        matrix = self._at(apart)
        matrix[:, np.arange(n), np.arange(n)] += self.noise_m2[index]
        here = self._at(distance)
        solved = np.linalg.solve(matrix, here[..., None])[..., 0]
        explained: FloatArray = np.clip((here * solved).sum(axis=1), 0.0, self.covariance_m2[0])
        return explained

    def _at(self, distance_m: FloatArray) -> FloatArray:
        return np.interp(distance_m, self.distance_m, self.covariance_m2, right=0.0)


def _is_isotropic(process: FourierGaussianProcess) -> bool:
    parts = getattr(process.kernel, "parts", (process.kernel,))
    return all(getattr(part, "anisotropy", 1.0) == 1.0 for part in parts)
