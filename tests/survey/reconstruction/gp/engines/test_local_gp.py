"""Local neighbourhoods give the map of all points, where points are dense beside the length scale."""

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engine_choice import fit_process
from survey.reconstruction.gp.engines.local_gp import CovarianceTable, LocalGaussianProcess, SiteTree
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.kernels import Exponential, Kernel, Matern32, Matern52, Whittle

KERNEL = Matern32(25.0, 60.0)
SITE = (0.0, 0.0, 100.0, 100.0)


def points(n: int = 1200) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0.0, 100.0, (n, 2))
    z = 5.0 * np.sin(xy[:, 0] / 20.0) + np.abs(xy[:, 1] - 50.0) / 10.0 + 0.1 * rng.standard_normal(n)
    return xy, z, np.full(n, 0.1)


def test_neighbourhoods_agree_with_the_dense_process() -> None:
    reports: list[tuple[str, int, int]] = []
    local = LocalGaussianProcess.fit(
        *points(), KERNEL, bounds=SITE, progress=lambda what, done, total: reports.append((what, done, total))
    )
    dense = DenseGaussianProcess.fit(*points(), KERNEL)
    x, y = np.linspace(0.0, 100.0, 26), np.linspace(100.0, 0.0, 26)
    (mean, std), (exact_mean, exact_std) = (process.predict_on_axes(x, y) for process in (local, dense))
    # 256 neighbours screen the rest: a tenth of the standard deviation.
    assert np.abs((mean - exact_mean) / exact_std).max() < 0.1
    np.testing.assert_allclose(std, exact_std, rtol=0.02)
    for one, other in zip(local.leave_one_out(), dense.leave_one_out(), strict=True):
        np.testing.assert_allclose(one, other, atol=0.02)
    assert reports[-1][1] == reports[-1][2]
    assert local.expected_s(x, y) > 0.0
    with pytest.raises(InputError, match="no joint samples"):
        local.sample_on_axes(x, y, 1, np.random.default_rng(0))


def test_nodes_that_are_dense_beside_the_points_lie_on_a_spline_near_the_exact_process() -> None:
    local = LocalGaussianProcess.fit(*points(), KERNEL, bounds=SITE)
    x, y = np.linspace(0.0, 100.0, 601), np.linspace(100.0, 0.0, 601)
    mean, std = local.predict_on_axes(x, y)
    some = np.s_[3::31, 5::31]
    exact, variance = local.predict(np.stack(np.meshgrid(x, y), axis=-1)[some].reshape(-1, 2))
    off = np.abs(mean[some].ravel() - exact) / np.sqrt(variance)
    # A spline, which is held to 5 % in 24 of the tiles.
    assert 1e-9 < off.max() < 0.1
    np.testing.assert_allclose(std[some].ravel(), np.sqrt(variance), rtol=0.1)


def test_tiles_without_a_node_and_uneven_axes_are_mapped() -> None:
    local = LocalGaussianProcess.fit(*points(), KERNEL, bounds=SITE)
    x, y = np.array([3.0, 40.0, 44.0, 97.0]), np.array([80.0, 11.0])
    assert local.expected_s(x, y) > 0.0
    mean, _ = local.predict_on_axes(x, y)
    exact, _ = local.predict(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    np.testing.assert_allclose(mean.ravel(), exact, atol=1e-9)


@pytest.mark.parametrize(
    "kernel",
    [
        Whittle(4.0, 30.0),
        Sum(Matern52(9.0, 80.0, 1.4, 35.0), Exponential(0.3, 9.0, 1.4, 35.0)),
        Sum(Matern52(9.0, 80.0, 1.4, 35.0), Exponential(0.3, 9.0)),
        Matern32(4.0, 0.2),
    ],
    ids=["whittle", "anisotropic", "two metrics", "short"],
)
def test_a_table_gives_the_covariance_of_every_pair(kernel: Kernel) -> None:
    xy = points(200)[0]
    table = CovarianceTable(kernel)
    exact = kernel.covariance(xy, xy)
    np.testing.assert_allclose(np.tril(table.among(xy)), np.tril(exact), atol=1e-5 * kernel.variance_m2)
    np.testing.assert_allclose(table.between(xy, xy[:7]), exact[:, :7], atol=1e-5 * kernel.variance_m2)


def test_every_node_lies_in_one_tile() -> None:
    xy = points()[0]
    tree = SiteTree.of(xy, SITE, 48)
    x, y = np.linspace(0.0, 100.0, 31), np.linspace(100.0, 0.0, 41)
    count = np.zeros((41, 31), dtype=int)
    for tile in range(len(tree)):
        count[tree.nodes_in(tile, x, y)] += 1
    assert (count == 1).all()
    assert np.bincount(tree.tile_of(xy)).max() <= 48


def test_a_rough_site_that_does_not_settle_falls_back_to_neighbourhoods() -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.0, 5000.0, (20_000, 2))
    process, choice = fit_process(
        "gp",
        Matern32(900.0, 20.0),
        xy,
        rng.standard_normal(20_000),
        np.full(20_000, 0.01),
        bounds=None,
        trend="none",
        config=GaussianProcessConfig(memory_mb=2.0),
    )
    assert isinstance(process, LocalGaussianProcess)
    assert choice.engine == "local"
