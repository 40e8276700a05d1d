r"""Average of Gaussian processes with several kernels, each conditioned on the same points.

With the weights w, means m and variances v of the processes,

.. math::  m(x) = \sum_k w_k(x) m_k(x), \qquad
           k(x, x') = \sum_k \sqrt{w_k(x) w_k(x')} \left( k_k(x, x') + d_k(x) d_k(x') \right), \qquad d_k = m_k - m

(Hoeting et al., Statist. Sci. 14, 1999), so that what is not known of the kernel is in the standard deviation. A weight is a
constant, or the share of a patch of the site where the kernel holds. The average is no Gaussian process; its intervals are
those of a normal distribution with these moments.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from survey.core import FloatArray
from survey.reconstruction.gp.engines.regression import Process
from survey.reconstruction.gp.marginal_likelihood import Patch

# Arm of the difference that gives the slope of the weights [m].
_ARM_M = 0.5


@dataclass(frozen=True)
class AveragedProcess(Process):
    """Processes with their weights, the heaviest first.

    `weights` (K,): weights of the processes, which sum to 1 at every place with the shares of their patches. `nuggets_m2`
    (K,): variance of the relief that each process takes as noise [m²]. `patches`: where each holds, None for everywhere.
    """

    parts: tuple[Process, ...]
    weights: FloatArray
    nuggets_m2: FloatArray
    patches: tuple[Patch | None, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "kernel", self.parts[0].kernel)
        object.__setattr__(self, "data", self.parts[0].data)

    @property
    def divides_site(self) -> bool:  # type: ignore[override]  # of the parts, not of the class
        """Whether parts of the site are conditioned one by one."""
        return any(part.divides_site for part in self.parts)

    @property
    def solves_each_node(self) -> bool:  # type: ignore[override]  # of the parts, not of the class
        """Whether every node of a map costs a solve with all points or cells."""
        return any(part.solves_each_node for part in self.parts)

    @property
    def nugget_m(self) -> float:
        """Root of the mean variance of the nuggets [m]."""
        return float(np.sqrt(self.weights @ self.nuggets_m2 / self.weights.sum()))

    @property
    def log_marginal_likelihood(self) -> float:
        """Logarithm of the density of the values with the heaviest kernel."""
        return self.parts[0].log_marginal_likelihood

    def predict(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (M,) at places (M, 2)."""
        every = [part.predict(xy) for part in self.parts]
        variances = [part.surface_variance(v, xy) for part, (_, v) in zip(self.parts, every, strict=True)]
        return self._moments(xy, [mean for mean, _ in every], variances)

    def predict_on_axes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (H, W) on the nodes of two axes."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        means, variances = [], []
        for part in self.parts:
            mean, std = (values.ravel() for values in part.predict_on_axes(x, y))
            means.append(mean)
            variances.append(part.surface_variance(std**2, nodes))
        mean, variance = self._moments(nodes, means, variances)
        shape = (len(y), len(x))
        return mean.reshape(shape), np.sqrt(variance).reshape(shape)

    def gradient(self, xy: FloatArray) -> FloatArray:
        """Return the slope of the mean (M, 2)."""
        weights = self._weights_at(xy)
        slope: FloatArray = np.einsum("km,kmi->mi", weights, [part.gradient(xy) for part in self.parts])
        if any(patch is not None for patch in self.patches):
            means = np.array([part.predict(xy)[0] for part in self.parts])
            for axis, arm in enumerate(_ARM_M * np.eye(2)):
                rise = self._weights_at(xy + arm) - self._weights_at(xy - arm)
                slope[:, axis] += np.sum(rise * means, axis=0) / (2.0 * _ARM_M)
        return slope

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance (N,) that the other values predict for each value, its noise included."""
        every = [part.leave_one_out() for part in self.parts]
        return self._moments(self.data.xy, [mean for mean, _ in every], [variance for _, variance in every])

    def update(self, xy: FloatArray, values: FloatArray, sigma_m: FloatArray) -> Self:
        """Return the process that is conditioned on more values, whose errors include the mean variance of the nuggets."""
        own_m2 = sigma_m**2 - self.nugget_m**2
        parts = [
            part.update(xy, values, np.sqrt(own_m2 + nugget_m2))
            for part, nugget_m2 in zip(self.parts, self.nuggets_m2, strict=True)
        ]
        return replace(self, parts=tuple(parts))

    def record(self) -> dict[str, Any]:
        """Return name and resolution of the engine of the heaviest kernel, and the kernels with their weights."""
        kernels = [
            {"weight": float(weight), "nugget_m": float(np.sqrt(nugget_m2)), **part.kernel.parameters()}
            | ({} if patch is None else {"centre_m": list(patch.centres_m[patch.number])})
            for part, weight, nugget_m2, patch in zip(
                self.parts, self.weights, self.nuggets_m2, self.patches, strict=True
            )
        ]
        divided = next((part.record() for part in self.parts if part.divides_site), {})
        return {**divided, **self.parts[0].record(), "kernels": kernels}

    def facts(self) -> dict[str, Any]:
        """Return what was estimated beside the surface with the heaviest kernel, for the record."""
        return self.parts[0].facts()

    def expected_s(self, x: FloatArray, y: FloatArray) -> float:
        """Return the expected time to judge the points and to map the nodes of two axes [s]."""
        return sum(part.expected_s(x, y) for part in self.parts)

    def sample_on_axes(self, x: FloatArray, y: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw n joint surfaces (n, H, W) [m] with the covariance of the average on the nodes of two axes."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        shape = (len(y), len(x))
        roots = np.sqrt(self._weights_at(nodes)).reshape(-1, *shape)
        means = np.array([part.predict_on_axes(x, y)[0] for part in self.parts])
        mean = np.sum(roots**2 * means, axis=0)
        surfaces = np.tile(mean, (n, 1, 1))
        for part, root, own in zip(self.parts, roots, means, strict=True):
            signs = rng.choice([-1.0, 1.0], size=(n, 1, 1))
            surfaces += root * (part.sample_on_axes(x, y, n, rng) - own + signs * (own - mean))
        return surfaces

    def weighted_sum(self, xy: FloatArray, weights: FloatArray) -> tuple[float, float]:
        """Return mean and standard deviation of the weighted sum of heights at places (M, 2)."""
        shares = self._weights_at(xy)
        means = np.array([part.predict(xy)[0] for part in self.parts])
        mean = np.sum(shares * means, axis=0)
        variance = 0.0
        for part, share, own in zip(self.parts, shares, means, strict=True):
            rooted = weights * np.sqrt(share)
            variance += part.weighted_sum(xy, rooted)[1] ** 2 + float(rooted @ (own - mean)) ** 2
        return float(weights @ mean), float(np.sqrt(variance))

    def joint_covariance(self, xy: FloatArray) -> FloatArray:
        """Return the posterior covariance (M, M) [m²] of the surface at places (M, 2)."""
        shares = self._weights_at(xy)
        means = np.array([part.predict(xy)[0] for part in self.parts])
        off = means - np.sum(shares * means, axis=0)
        total = np.zeros((len(xy), len(xy)))
        for part, root, own in zip(self.parts, np.sqrt(shares), off, strict=True):
            total += np.outer(root, root) * (part.joint_covariance(xy) + np.outer(own, own))
        return total

    def derivative_variance_on_axes(self, x: FloatArray, y: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the variance (H * W,) of the derivative along a vector (2,), without that of a trend."""
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        every = [part.derivative_variance_on_axes(x, y, direction) for part in self.parts]
        variance: FloatArray = np.sum(self._weights_at(nodes) * every, axis=0)
        return variance

    def _weights_at(self, xy: FloatArray) -> FloatArray:
        """Return the weights (K, M) at places (M, 2), which sum to 1."""
        shares = [np.ones(len(xy)) if patch is None else patch.share(xy) for patch in self.patches]
        weights: FloatArray = self.weights[:, None] * np.array(shares)
        weights /= weights.sum(axis=0)
        return weights

    def _moments(
        self, xy: FloatArray, means: list[FloatArray], variances: list[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the mean and the variance (M,) of the average at places (M, 2)."""
        weights, every = self._weights_at(xy), np.array(means)
        mean = np.sum(weights * every, axis=0)
        variance = np.sum(weights * (np.array(variances) + (every - mean) ** 2), axis=0)
        return mean, variance
