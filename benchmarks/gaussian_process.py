"""The Gaussian-process engine against scikit-learn, a dense Cholesky factorization and other tools.

Mean and standard deviation on the 601 x 601 nodes of a 600 m site, squared exponential of 10 m² and 17.75 m.
Tools that need minutes are timed on a stated subset of the nodes and scaled. Ratios compare mean and standard deviation of
both, most of which time a dense process takes for its standard deviation; rows named *mean alone* compare the means.
"""

import multiprocessing
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.gaussian_process_peers import against_peers
from benchmarks.landmarks import SIZE_M, Site, landmarks
from benchmarks.report import Row, cpu_seconds, fastest, main, peak_memory_mb
from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
from survey.reconstruction.gp.kernels import SquaredExponential

KERNEL = SquaredExponential(variance_m2=10.0, length_scale_m=17.75)
AXIS = np.linspace(0.0, SIZE_M, 601)
BOUNDS = (0.0, 0.0, SIZE_M, SIZE_M)
N_NODES = AXIS.size**2
SEED = 11
PACKAGES = ("numpy", "scipy", "finufft", "numba", "scikit-learn", "gpytorch", "pykrige", "gstools", "verde")

Points = tuple[FloatArray, FloatArray, FloatArray]
Maps = tuple[FloatArray, FloatArray]


def points_of(n: int) -> Points:
    """Landmarks as residuals of their mean."""
    xy, z, sigma = landmarks(Site.drawn(SEED), n, SEED)
    return xy, z - z.mean(), sigma


def fitted(points: Points, tolerance_m: float = 1e-3) -> FourierGaussianProcess:
    return FourierGaussianProcess.fit(*points, KERNEL, bounds=BOUNDS, tolerance_m=tolerance_m)


def mapped(points: Points, tolerance_m: float = 1e-3) -> Maps:
    return fitted(points, tolerance_m).predict_on_axes(AXIS, AXIS)


def chosen_nodes(n: int) -> IntArray:
    """Return indices of random nodes, a fifth of them on the site's edge where a periodic box errs most."""
    rng = np.random.default_rng(SEED)
    row, column = np.divmod(np.arange(N_NODES), AXIS.size)
    edge = np.minimum.reduce([row, column, AXIS.size - 1 - row, AXIS.size - 1 - column]) == 0
    on_edge = rng.choice(np.flatnonzero(edge), n // 5, replace=False)
    inside = rng.choice(np.flatnonzero(~edge), n - n // 5, replace=False)
    return np.concatenate([on_edge, inside])


def places(nodes: IntArray) -> FloatArray:
    row, column = np.divmod(nodes, AXIS.size)
    return np.stack([AXIS[column], AXIS[row]], axis=-1)


def worst(maps: Maps, nodes: IntArray, reference: Sequence[FloatArray]) -> tuple[float, float]:
    """Largest differences of mean and standard deviation [mm] at nodes."""
    mean, std = (1e3 * np.abs(m.ravel()[nodes] - r).max() for m, r in zip(maps, reference, strict=True))
    return float(mean), float(std)


def against_exact_tools(quick: bool) -> Iterator[Row]:
    """Bars 1, 2 and 4: 5,000 points against scikit-learn and a blocked dense Cholesky."""
    # Here, so that the processes whose memory is measured do not hold scikit-learn.
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    points = points_of(5000)
    xy, residual, sigma = points
    nodes = chosen_nodes(1000 if quick else 4000)
    maps, ours = fastest(lambda: mapped(points), 2 if quick else 3)
    yield Row("ours, 5,000 points", ours, "s")

    peer = GaussianProcessRegressor(ConstantKernel(10.0) * RBF(17.75), alpha=sigma**2, optimizer=None)
    _, fit = cpu_seconds(lambda: peer.fit(xy, residual))
    blocks = np.array_split(places(nodes), len(nodes) // 1000)
    answers = [cpu_seconds(partial(peer.predict, block, return_std=True)) for block in blocks]
    scaled = (
        fit + min(seconds / len(block) for (_, seconds), block in zip(answers, blocks, strict=True)) * N_NODES
    )
    reference = tuple(np.concatenate([answer[k] for answer, _ in answers]) for k in (0, 1))
    yield Row(f"scikit-learn, scaled from {len(nodes)} nodes", scaled, "s")
    yield Row.of("faster than scikit-learn", scaled / ours, "x", ">=", 150)
    yield from _mean_alone(points, peer, blocks, fit, quick=quick)
    mean_mm, std_mm = worst(maps, nodes, reference)
    yield Row.of("largest difference of the mean", mean_mm, "mm", "<=", 1.0)
    yield Row.of("largest difference of the standard deviation", std_mm, "mm", "<=", 0.1)

    dense, fit = cpu_seconds(lambda: DenseGaussianProcess.fit(xy, residual, sigma, KERNEL))
    _, ask = cpu_seconds(lambda: dense.predict(places(nodes[:1000])))
    scaled = fit + ask / 1000 * N_NODES
    yield Row("own dense Cholesky, scaled from 1000 nodes", scaled, "s")
    yield Row.of("faster than own dense Cholesky", scaled / ours, "x", ">=", 100)
    yield from likelihood(points, peer, quick=quick)
    if not quick:
        yield from against_peers(points, places(nodes), N_NODES, ours)


def _mean_alone(
    points: Points, peer: Any, blocks: Sequence[FloatArray], fit_s: float, *, quick: bool
) -> Iterator[Row]:
    """Yield the same comparison without standard deviations."""
    _, ours = fastest(lambda: fitted(points).mean_on_axes(AXIS, AXIS), 2 if quick else 3)
    asked = min(cpu_seconds(partial(peer.predict, block))[1] / len(block) for block in blocks)
    theirs = fit_s + asked * N_NODES
    yield Row("mean alone, ours", ours, "s")
    yield Row("mean alone, scikit-learn, scaled", theirs, "s")
    yield Row("mean alone, faster than scikit-learn", theirs / ours, "x")


def likelihood(points: Points, peer: Any, *, quick: bool) -> Iterator[Row]:
    """Bar 4: log marginal likelihood of one kernel."""

    def evaluate() -> float:
        return fitted(points, tolerance_m=4e-4).log_marginal_likelihood

    value, ours = fastest(evaluate, 1 if quick else 3)
    theta = peer.kernel_.theta
    exact, theirs = cpu_seconds(lambda: peer.log_marginal_likelihood(theta, clone_kernel=False))
    yield Row("likelihood, ours", ours, "s")
    yield Row("likelihood, scikit-learn", theirs, "s")
    yield Row("likelihood, faster", theirs / ours, "x")
    yield Row.of("likelihood, difference", abs(value - exact), "nats", "<=", 0.05)


def against_size(quick: bool) -> Iterator[Row]:
    """Bar 3: the same map from ten and two hundred times the points."""
    few, many = points_of(5000), points_of(50_000)
    _, base = fastest(lambda: mapped(few), 1 if quick else 3)
    maps, seconds = fastest(lambda: mapped(many), 1 if quick else 3)
    nodes = np.arange(N_NODES)
    converged = FourierGaussianProcess.fit(
        *many, KERNEL, bounds=BOUNDS, tolerance_m=1e-4 if quick else 2e-5, memory_mb=900
    )
    reference = converged.predict_on_axes(AXIS, AXIS)
    mean_mm, std_mm = worst(maps, nodes, (reference[0].ravel(), reference[1].ravel()))
    yield Row.of("50,000 points, time over that of 5,000", seconds / base, "x", "<=", 2)
    yield Row.of("50,000 points, mean against a converged cut", mean_mm, "mm", "<=", 1.0)
    yield Row.of("50,000 points, standard deviation against a converged cut", std_mm, "mm", "<=", 0.1)
    n = 250_000 if quick else 1_000_000
    most = points_of(n)
    _, seconds = cpu_seconds(lambda: mapped(most))
    yield Row.of(f"{n:,} points, time over that of 5,000", seconds / base, "x", "<=", 10)


def update(quick: bool) -> Iterator[Row]:
    """Bar 5: 100 more landmarks and a fresh map against a refit."""
    xy, residual, sigma = points_of(5000)
    old, new = slice(0, 4900), slice(4900, 5000)
    before = fitted((xy[old], residual[old], sigma[old]))
    before.predict_on_axes(AXIS, AXIS)

    def refit() -> Maps:
        gp = FourierGaussianProcess.fit(xy, residual, sigma, KERNEL, resolution=before.resolution)
        return gp.predict_on_axes(AXIS, AXIS)

    def add() -> Maps:
        return before.update(xy[new], residual[new], sigma[new]).predict_on_axes(AXIS, AXIS)

    refitted, slow = fastest(refit, 1 if quick else 3)
    maps, fast = fastest(add, 1 if quick else 3)
    gap = max(float(np.abs(a - b).max()) for a, b in zip(maps, refitted, strict=True))
    yield Row("100 more points and a map", fast, "s")
    yield Row.of("100 more points, faster than a refit", slow / fast, "x", ">=", 5)
    yield Row.of("100 more points, difference from a refit", gap, "m", "<=", 1e-6)


def _memory_of(n: int) -> float:
    """Peak memory of a process that makes one map [MB]."""
    mapped(points_of(n))
    return peak_memory_mb()


def memory(_: bool) -> Iterator[Row]:
    """Bar 6: peak memory of a fresh process, libraries included."""
    context = multiprocessing.get_context("spawn")
    for n in (5000, 50_000):
        with context.Pool(1) as pool:
            peak = pool.apply(_memory_of, (n,))
        yield Row.of(f"peak memory, {n:,} points", peak, "MB", "<=", 400)


def measure(quick: bool) -> Iterator[Row]:
    """Every row of the table."""
    mapped(points_of(200))  # compiled before anything is timed
    yield from memory(quick)
    yield from against_exact_tools(quick)
    yield from against_size(quick)
    yield from update(quick)
    # Here, so that the processes whose memory is measured hold neither files' nor plotting libraries.
    from benchmarks import gp_quality

    # The quick table leaves bars 7 and 9 to `python -m benchmarks.gp_quality --quick`, for want of time.
    yield from gp_quality.errors_in_variables(True) if quick else gp_quality.measure(False)
    if not quick:
        from benchmarks.gaussian_process_figures import cost_figure

        cost_figure(points_of, FourierGaussianProcess.fit, AXIS)


if __name__ == "__main__":
    main("Gaussian process", measure, PACKAGES)
