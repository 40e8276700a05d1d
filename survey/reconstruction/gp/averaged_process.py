r"""Average of Gaussian processes with several kernels, each conditioned on the same points.

With the weights w, means m and variances v of the processes,

.. math::  m(x) = \sum_k w_k m_k(x), \qquad v(x) = \sum_k w_k \left( v_k(x) + (m_k(x) - m(x))^2 \right)

(Hoeting et al., Statist. Sci. 14, 1999), so that what is not known of the kernel is in the standard deviation. The average
is no Gaussian process; its intervals are those of a normal distribution with these moments.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from survey.core import FloatArray
from survey.reconstruction.gp.engines.regression import Process


@dataclass(frozen=True)
class AveragedProcess(Process):
    """Processes with their weights, which sum to 1, the heaviest first.

    `nuggets_m2`: variance of the relief that each process takes as noise [m²].
    """

    parts: tuple[Process, ...]
    weights: FloatArray
    nuggets_m2: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "kernel", self.parts[0].kernel)
        object.__setattr__(self, "data", self.parts[0].data)

    @property
    def divides_site(self) -> bool:  # type: ignore[override]  # of the parts, not of the class
        """Whether parts of the site are conditioned one by one."""
        return any(part.divides_site for part in self.parts)

    @property
    def nugget_m(self) -> float:
        """Root of the mean variance of the nuggets [m]."""
        return float(np.sqrt(self.weights @ self.nuggets_m2))

    @property
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the density of the values with the heaviest kernel."""
        return self.parts[0].log_marginal_likelihood

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at places (M, 2)."""
        every = [part.predict(xy) for part in self.parts]
        return self._moments(
            [mean for mean, _ in every],
            [part.surface_variance(v, xy) for part, (_, v) in zip(self.parts, every, strict=True)],
        )

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) on the nodes of two axes."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        means, variances = [], []
        for part in self.parts:
            mean, std = part.predict_on_axes(x, y)
            means.append(mean)
            variances.append(part.surface_variance(std.ravel() ** 2, nodes).reshape(std.shape))
        mean, variance = self._moments(means, variances)
        return mean, np.sqrt(variance)

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope of the mean (M, 2)."""
        return self._mean([part.gradient(xy) for part in self.parts])

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (N,) that the other values predict for each value, its noise included."""
        every = [part.leave_one_out() for part in self.parts]
        return self._moments([mean for mean, _ in every], [variance for _, variance in every])

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process that is conditioned on more values, whose errors include the mean variance of the nuggets."""
        own_m2 = sigma_m**2 - float(self.weights @ self.nuggets_m2)
        parts = [
            part.update(xy, values, np.sqrt(own_m2 + nugget_m2))
            for part, nugget_m2 in zip(self.parts, self.nuggets_m2, strict=True)
        ]
        return replace(self, parts=tuple(parts))

    def record(self) -> dict[str, Any]:
        """Return name and resolution of the engine of the heaviest kernel, and the kernels with their weights."""
        kernels = [
            {"weight": float(weight), "nugget_m": float(np.sqrt(nugget_m2)), **part.kernel.parameters()}
            for part, weight, nugget_m2 in zip(self.parts, self.weights, self.nuggets_m2, strict=True)
        ]
        return {**self.parts[0].record(), "kernels": kernels}

    def facts(self) -> dict[str, Any]:
        """Return what was estimated beside the surface with the heaviest kernel, for the record."""
        return self.parts[0].facts()

    def expected_s(self, x: FloatArray, y: FloatArray) -> float:
        """Return the expected time to judge the points and to map the nodes of two axes [s]."""
        return sum(part.expected_s(x, y) for part in self.parts)

    def sample_on_axes(self, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces (n, H, W) [m] on the nodes of two axes, each with a kernel that is drawn too."""
        drawn = rng.choice(len(self.parts), size=n, p=self.weights)
        surfaces = np.empty((n, len(y), len(x)))
        for k, part in enumerate(self.parts):
            mine = np.flatnonzero(drawn == k)
            if len(mine):
                surfaces[mine] = part.sample_on_axes(x, y, len(mine), rng)
        return surfaces

    def weighted_sum(self, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
        """Return mean and standard deviation of the weighted sum of heights at places (M, 2)."""
        every = np.array([part.weighted_sum(xy, weights) for part in self.parts])
        mean, variance = self._moments(list(every[:, 0]), list(every[:, 1] ** 2))
        return float(mean), float(np.sqrt(variance))

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2)."""
        means = np.array([part.predict(xy)[0] for part in self.parts])
        off = means - self.weights @ means
        of_means: FloatArray = (self.weights * off.T) @ off
        return self._mean([part.joint_covariance(xy) for part in self.parts]) + of_means

    def derivative_variance_on_axes(self, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (H * W,) of the derivative along a vector (2,), without that of a trend."""
        return self._mean([part.derivative_variance_on_axes(x, y, direction) for part in self.parts])

    def _mean(self, values: list[FloatArray]) -> FloatArray:
        mean: FloatArray = np.tensordot(self.weights, np.array(values), axes=1)
        return mean

    def _moments(self, means: list[FloatArray], variances: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the mean and the variance of the average."""
        mean = self._mean(means)
        spread = self._mean([(one - mean) ** 2 for one in means])
        return mean, self._mean(variances) + spread
