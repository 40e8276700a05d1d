"""Other tools on the same landmarks, each timed on a stated subset of the nodes and scaled to all of them.

They answer different questions: PyKrige has one nugget where we have a standard deviation per point, Verde and
SciPy state no standard deviation.  Each is left out where it is not installed (``pip install firnline[peers]``).
"""

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.report import Row, cpu_seconds
from survey.core.arrays import FloatArray

Points = tuple[FloatArray, FloatArray, FloatArray]
Predict = Callable[[FloatArray], Any]

VARIANCE_M2, LENGTH_M = 10.0, 17.75


@dataclass(frozen=True)
class Peer:
    """One tool: its module, how it is fitted, and how many nodes it is timed on."""

    name: str
    module: str
    fit: Callable[[Points], Predict]
    n_nodes: int


def _gpytorch(points: Points) -> Predict:
    """Exact inference in double precision with the Cholesky factorization."""
    gpytorch, torch = importlib.import_module("gpytorch"), importlib.import_module("torch")
    torch.set_num_threads(1)
    xy, z, variance = (torch.tensor(a, dtype=torch.float64) for a in (points[0], points[1], points[2] ** 2))
    likelihood = gpytorch.likelihoods.FixedNoiseGaussianLikelihood(noise=variance)

    class Exact(gpytorch.models.ExactGP):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            super().__init__(xy, z, likelihood)
            self.mean_module = gpytorch.means.ZeroMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.RBFKernel())

        def forward(self, x: Any) -> Any:
            return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    model = Exact().double()
    model.covar_module.outputscale, model.covar_module.base_kernel.lengthscale = VARIANCE_M2, LENGTH_M
    model.eval()

    def predict(nodes: FloatArray) -> Any:
        with (
            torch.no_grad(),
            gpytorch.settings.max_cholesky_size(10**6),
            gpytorch.settings.skip_posterior_variances(False),
        ):
            answer = model(torch.tensor(nodes))
            return answer.mean.numpy(), answer.variance.numpy()

    return predict


def _pykrige(points: Points) -> Predict:
    """Ordinary kriging with the 50 nearest points and the median noise as nugget."""
    kriging = importlib.import_module("pykrige.ok").OrdinaryKriging
    xy, z, sigma = points
    # PyKrige's Gaussian model is exp(-d² / (4/7 range)²)
    parameters = {
        "psill": VARIANCE_M2,
        "range": LENGTH_M * np.sqrt(2) * 7 / 4,
        "nugget": float(np.median(sigma**2)),
    }
    tool = kriging(xy[:, 0], xy[:, 1], z, variogram_model="gaussian", variogram_parameters=parameters)
    return lambda nodes: tool.execute("points", nodes[:, 0], nodes[:, 1], backend="loop", n_closest_points=50)


def _gstools(points: Points) -> Predict:
    """Krige with a known mean and a measurement error per point."""
    gstools = importlib.import_module("gstools")
    xy, z, sigma = points
    # GSTools' Gaussian model is exp(-π/4 d² / len_scale²)
    model = gstools.Gaussian(dim=2, var=VARIANCE_M2, len_scale=LENGTH_M * np.sqrt(np.pi / 2))
    tool = gstools.krige.Simple(model, xy.T, z, mean=0.0, exact=False, cond_err=sigma**2)
    return lambda nodes: tool(nodes.T)


def _verde(points: Points) -> Predict:
    """Biharmonic spline, without a standard deviation."""
    spline = importlib.import_module("verde").Spline(mindist=1.0, damping=1e-6)
    xy, z, sigma = points
    spline.fit((xy[:, 0], xy[:, 1]), z, weights=1 / sigma**2)
    return lambda nodes: spline.predict((nodes[:, 0], nodes[:, 1]))


def _scipy(points: Points) -> Predict:
    """Radial basis functions on the 50 nearest points, without a standard deviation."""
    interpolate = importlib.import_module("scipy.interpolate")
    xy, z, _ = points
    result: Predict = interpolate.RBFInterpolator(xy, z, neighbors=50, smoothing=1e-3)
    return result


PEERS = (
    Peer("GPyTorch exact", "gpytorch", _gpytorch, 2000),
    Peer("PyKrige, 50 nearest", "pykrige", _pykrige, 2000),
    Peer("GSTools", "gstools", _gstools, 100),
    Peer("Verde spline, no std", "verde", _verde, 4000),
    Peer("SciPy radial basis, 50 nearest, no std", "scipy", _scipy, 10_000),
)


def against_peers(points: Points, nodes: FloatArray, n_all: int, ours_s: float) -> Iterator[Row]:
    """Time of every installed tool, scaled to all nodes, and how many times ours it is."""
    for peer in PEERS:
        try:
            importlib.import_module(peer.module)
        except ImportError:
            continue
        predict, fit_s = cpu_seconds(partial(peer.fit, points))
        few = nodes[: peer.n_nodes]
        _, ask_s = cpu_seconds(partial(predict, few))
        scaled = fit_s + ask_s / len(few) * n_all
        yield Row(f"{peer.name}, scaled from {len(few)} nodes", scaled, "s")
        yield Row(f"{peer.name}, time over ours", scaled / ours_s, "x")
