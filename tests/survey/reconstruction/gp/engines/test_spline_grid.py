"""Prediction on a fine grid by splines: within the tolerance at every node, exact at nodes near points, and everywhere on rough terrain."""

import numpy as np
import pytest

from survey import Grid
from survey.data import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess
from survey.reconstruction.gp.engines.spline_grid import first_stride, predict_on_fine_axes
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.kernels import Exponential, Matern32, SquaredExponential

X, Y = np.arange(0.0, 181.0), np.arange(160.0, -1.0, -1.0)


def conditioned(kernel, sigma_m=0.1, n_points=40):
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.0, 160.0, (n_points, 2))
    return DenseGaussianProcess.fit(xy, np.sin(xy[:, 0] / 30.0), np.full(n_points, sigma_m), kernel)


class Counting:
    """A process that counts the nodes that it solves on axes."""

    def __init__(self, process):
        self.process, self.data, self.n_nodes = process, process.data, 0

    def predict(self, xy):
        self.n_nodes += len(xy)
        return self.process.predict(xy)

    def predict_on_axes(self, x, y):
        self.n_nodes += len(x) * len(y)
        return self.process.predict_on_axes(x, y)


@pytest.mark.parametrize("kernel", [SquaredExponential(1.0, 60.0), Matern32(1.0, 80.0)])
def test_smooth_terrain_takes_a_part_of_the_solves_and_errs_within_the_tolerance(kernel, monkeypatch):
    monkeypatch.setattr("survey.reconstruction.gp.engines.spline_grid._FEW", 2000)
    process = Counting(conditioned(kernel))
    mean, std = predict_on_fine_axes(process, X, Y, nugget_m=0.05)
    assert process.n_nodes < 0.4 * X.size * Y.size
    exact, spread = process.process.predict_on_axes(X, Y)
    ground = np.hypot(spread, 0.05)
    assert (np.abs(mean - exact) / ground).max() < 0.06
    assert (np.abs(std - spread) / ground).max() < 0.06


def test_terrain_that_is_rough_at_points_all_over_is_predicted_exactly(monkeypatch):
    monkeypatch.setattr("survey.reconstruction.gp.engines.spline_grid._FEW", 2000)
    process = conditioned(Exponential(1.0, 10.0), sigma_m=0.01, n_points=400)
    for found, exact in zip(
        predict_on_fine_axes(process, X, Y, nugget_m=0.0), process.predict_on_axes(X, Y), strict=True
    ):
        np.testing.assert_array_equal(found, exact)


def test_nodes_near_lines_of_points_are_exact_and_a_spline_gives_the_others(monkeypatch):
    monkeypatch.setattr("survey.reconstruction.gp.engines.spline_grid._FEW", 2000)
    xy = np.array([(x, y) for y in (30.0, 130.0) for x in np.arange(0.0, 181.0, 2.0)])
    kernel = Sum(SquaredExponential(9.0, 120.0), Matern32(0.01, 12.0))
    exact = DenseGaussianProcess.fit(xy, np.sin(xy[:, 0] / 30.0), np.full(len(xy), 0.02), kernel)
    process = Counting(exact)
    mean, std = predict_on_fine_axes(process, X, Y, nugget_m=0.0)
    assert process.n_nodes < 0.6 * X.size * Y.size
    of_every_node, spread = exact.predict_on_axes(X, Y)
    on_the_line = np.ix_(np.abs(Y - 30.0) <= 1.0, X > 0.0)
    np.testing.assert_allclose(mean[on_the_line], of_every_node[on_the_line], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(std[on_the_line], spread[on_the_line], rtol=0.0, atol=1e-9)
    assert (np.abs(mean - of_every_node) / spread).max() < 0.08
    assert (np.abs(std - spread) / spread).max() < 0.08


def test_a_grid_of_few_nodes_has_no_spline():
    assert first_stride(70, 80, n_points=40) == 1
    assert first_stride(600, 600, n_points=40) == 12
    assert first_stride(600, 600, n_points=90_000) == 2


def test_the_dense_engine_that_is_stated_stays_exact(monkeypatch):
    monkeypatch.setattr("survey.reconstruction.gp.engines.spline_grid._FEW", 200)
    rng = np.random.default_rng(5)
    xy = rng.uniform(0.0, 100.0, (30, 2))
    points = SurfacePoints(np.column_stack([xy, np.cos(xy[:, 1] / 40.0)]), sigma_m=0.1, crs="EPSG:32608")
    grid = Grid((0.0, 0.0, 100.0, 100.0), 2.0, "EPSG:32608")
    fitted = GaussianProcessTerrain(GaussianProcessConfig(), engine="dense").fit(points)
    process = fitted.learned_.process
    mean, _ = process.predict_on_axes(grid.x, grid.y)
    np.testing.assert_array_equal(
        fitted.learned_.on(grid)[0], mean + fitted.learned_.mean.at(grid.xy).reshape(grid.shape)
    )
