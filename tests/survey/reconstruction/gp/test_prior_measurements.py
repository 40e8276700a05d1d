"""Cells of a prior as measurements: equations, weight beside dense points, errors of the prior, and model files."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from affine import Affine

from survey.core import FloatArray
from survey.data import Dem, Grid, SurfacePoints
from survey.reconstruction import reconstruct
from survey.reconstruction.gp.averaged_process import AveragedProcess
from survey.reconstruction.gp.conditioning import ConditioningTask, PriorMeasurements, condition_all
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.regression import DenseGaussianProcess, Process
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters
from survey.reconstruction.gp.prior_measurements import ProcessAtLevels, ProcessWithCells
from survey.reconstruction.gp.satellite_cells import SatelliteCells
from survey.reconstruction.prior import SatelliteErrors
from survey.reconstruction.prior_likelihood import ErrorSizes

CRS = "EPSG:32608"
SIDE_M, CELL_M, SIGMA_M = 240.0, 30.0, 0.1
KERNEL = SquaredExponential(9.0, 60.0)
ERRORS = SatelliteErrors().model()
GRID = Grid((0.0, 0.0, SIDE_M, SIDE_M), 10.0, CRS)


def ground(xy: FloatArray) -> FloatArray:
    return 3.0 * np.sin(xy[:, 0] / 35.0) * np.cos(xy[:, 1] / 45.0) + 0.02 * xy[:, 0]


def survey_points(spacing_m: float) -> SurfacePoints:
    lines = np.arange(0.5 * spacing_m, SIDE_M, spacing_m)
    xy = np.stack(np.meshgrid(np.arange(0.0, SIDE_M + 1.0, 10.0), lines), axis=-1).reshape(-1, 2)
    z = ground(xy) + SIGMA_M * np.random.default_rng(1).standard_normal(len(xy))
    return SurfacePoints(np.column_stack([xy, z]), sigma_m=SIGMA_M, crs=CRS)


def prior(error_m: float = 0.5, offset_m: float = 0.3) -> Dem:
    """Means over cells of 30 m, with independent errors and an offset."""
    n = int(SIDE_M / CELL_M)
    inside = (np.arange(10) + 0.5) / 10.0 * CELL_M
    corner = np.stack(np.meshgrid(np.arange(n) * CELL_M, np.arange(n)[::-1] * CELL_M), axis=-1).reshape(
        -1, 1, 2
    )
    places = corner + np.stack(np.meshgrid(inside, inside), axis=-1).reshape(1, -1, 2)
    height = ground(places.reshape(-1, 2)).reshape(n * n, -1).mean(axis=1)
    height = height + error_m * np.random.default_rng(2).standard_normal(n * n) + offset_m
    return Dem(height.reshape(n, n), Affine(CELL_M, 0.0, 0.0, 0.0, -CELL_M, SIDE_M), CRS)


def sized(cells: SatelliteCells) -> SatelliteCells:
    return cells.with_sizes(ErrorSizes(0.5, 0.3, 100.0, 0.0, 0.0, 0.0))


def process(points: SurfacePoints, engine: str = "dense") -> Process:
    given = points.xy, points.z, np.full(len(points), SIGMA_M), KERNEL
    if engine == "dense":
        return DenseGaussianProcess.fit(*given, trend="constant")
    return FourierGaussianProcess.fit(*given, trend="constant", bounds=(-40.0, -40.0, 280.0, 280.0))


@pytest.mark.parametrize("engine", ["dense", "fourier"])
def test_points_and_cells_are_conditioned_on_as_one_set_of_measurements(engine: str) -> None:
    points, dem = survey_points(60.0), prior()
    cells = sized(SatelliteCells.of(dem, dem.crs, GRID.bounds, ERRORS))
    given = ProcessWithCells(process(points, engine), cells)
    places = np.random.default_rng(3).uniform(0.0, SIDE_M, (30, 2))
    mean, variance = given.predict(places)
    # The same by one dense system: a cell is the mean of its four Gauss nodes.
    nodes = given.means_over_cells.nodes
    total = np.concatenate([points.xy, nodes])
    operator = np.zeros((len(points) + len(cells), len(total)))
    operator[: len(points), : len(points)] = np.eye(len(points))
    for k in range(len(cells)):
        operator[len(points) + k, len(points) + 4 * k : len(points) + 4 * k + 4] = 0.25
    common = cells.common_rows * cells.common_sigma
    system = operator @ KERNEL.covariance(total, total) @ operator.T
    system[: len(points), : len(points)] += SIGMA_M**2 * np.eye(len(points))
    system[len(points) :, len(points) :] += cells.covariance + common @ common.T
    crossed = KERNEL.covariance(places, total) @ operator.T
    solved = np.linalg.solve(
        system, np.column_stack([np.r_[points.z, cells.height], np.ones(len(system)), crossed.T])
    )
    level = solved[:, 0].sum() / solved[:, 1].sum()
    expected = level + crossed @ (solved[:, 0] - level * solved[:, 1])
    gap = 1.0 - crossed @ solved[:, 1]
    left = KERNEL.variance_m2 - np.sum(crossed * solved[:, 2:].T, axis=1) + gap**2 / solved[:, 1].sum()
    tolerance = 1e-6 if engine == "dense" else 5e-3
    np.testing.assert_allclose(mean, expected, atol=tolerance)
    np.testing.assert_allclose(np.sqrt(variance), np.sqrt(left), atol=tolerance)


def test_answers_of_one_process_agree_with_one_another() -> None:
    points, dem = survey_points(60.0), prior()
    given = ProcessWithCells(process(points), sized(SatelliteCells.of(dem, dem.crs, GRID.bounds, ERRORS)))
    mean, std = given.predict_on_axes(GRID.x, GRID.y)
    by_nodes = given.predict(GRID.xy)
    np.testing.assert_allclose(mean.ravel(), by_nodes[0], atol=1e-9)
    np.testing.assert_allclose(std.ravel(), np.sqrt(by_nodes[1]), atol=1e-9)
    places = GRID.xy[::40]
    covariance = given.joint_covariance(places)
    np.testing.assert_allclose(np.diag(covariance), given.predict(places)[1], atol=1e-9)
    assert given.weighted_sum(places, np.ones(len(places)))[1] == pytest.approx(np.sqrt(covariance.sum()))
    step = np.array([0.5, 0.0])
    rise = given.predict(places + step)[0] - given.predict(places - step)[0]
    np.testing.assert_allclose(given.gradient(places)[:, 0], rise, atol=1e-4)
    drawn = given.sample_on_axes(GRID.x[::4], GRID.y[::4], 4000, np.random.default_rng(4))
    np.testing.assert_allclose(drawn.std(axis=0), std[::4, ::4], rtol=0.12)


def test_leaving_one_out_is_a_fit_without_it() -> None:
    points, dem = survey_points(60.0), prior()
    cells = sized(SatelliteCells.of(dem, dem.crs, GRID.bounds, ERRORS))
    mean, variance = ProcessWithCells(process(points), cells).leave_one_out()
    for k in (0, 37):
        others = np.arange(len(points)) != k
        without = ProcessWithCells(process(points.select(others)), cells).predict(points.xy[[k]])
        assert mean[k] == pytest.approx(without[0][0], abs=1e-6)
        assert variance[k] == pytest.approx(without[1][0] + SIGMA_M**2, rel=1e-5)


def test_levels_that_share_their_cells_are_averaged_as_processes_of_their_own() -> None:
    points, dem = survey_points(60.0), prior(offset_m=8.0)
    base, cells = process(points), sized(SatelliteCells.of(dem, dem.crs, GRID.bounds, ERRORS))
    levels = [ProcessWithCells(base, cells.with_free_level(80.0)), ProcessWithCells(base, cells)]
    shared = ProcessAtLevels.of(levels, np.array([0.3, 0.7]))
    apart = AveragedProcess(tuple(levels[::-1]), np.array([0.7, 0.3]), np.zeros(2), (None, None))
    assert np.abs(levels[0].predict(GRID.xy)[0] - levels[1].predict(GRID.xy)[0]).max() > 0.01
    more = np.array([[101.0, 44.0]]), np.array([3.0]), np.array([0.1])
    for one, other in ((shared, apart), (shared.update(*more), apart.update(*more))):
        for found, expected in (
            (one.predict(GRID.xy), other.predict(GRID.xy)),
            (one.predict_on_axes(GRID.x, GRID.y), other.predict_on_axes(GRID.x, GRID.y)),
            (one.leave_one_out(), other.leave_one_out()),
        ):
            np.testing.assert_allclose(found[0], expected[0], atol=1e-9)
            np.testing.assert_allclose(found[1], expected[1], atol=1e-9)


def rmse(dem: Dem) -> float:
    return float(np.sqrt(np.mean((dem.elevation.ravel() - ground(GRID.xy)) ** 2)))


def test_a_prior_helps_sparse_lines_and_leaves_dense_ones_as_they_are() -> None:
    for spacing_m, most in ((120.0, 0.8), (20.0, 1.02)):
        points = survey_points(spacing_m)
        assert rmse(reconstruct(points, GRID, prior()).mean) < most * rmse(reconstruct(points, GRID).mean)


def test_a_wrong_prior_does_not_spoil_dense_lines() -> None:
    points = survey_points(20.0)
    wrong = prior(error_m=6.0, offset_m=40.0)
    mapped = reconstruct(points, GRID, wrong)
    assert rmse(mapped.mean) < 1.02 * rmse(reconstruct(points, GRID).mean)
    assert mapped.diagnostics["satellite_sigma_m"] > 3.0
    assert any("above the points" in one for one in mapped.diagnostics["prior_conflicts"])


def test_sizes_of_the_errors_are_found_and_a_wrong_level_counts_twice() -> None:
    points = survey_points(40.0)

    def conditioned(dem: Dem) -> Process:
        found = Hyperparameters("squared-exponential", KERNEL, 0.0, 0.0)
        task = ConditioningTask(
            "dense", GaussianProcessConfig(), GRID.bounds, "constant", PriorMeasurements(dem, ERRORS)
        )
        return condition_all(task, found, points.xy, points.z, np.full(len(points), SIGMA_M**2)).process

    alone = conditioned(prior(error_m=1.0, offset_m=0.0))
    assert isinstance(alone, ProcessWithCells)
    assert alone.cells.sizes.white_m == pytest.approx(1.0, rel=0.35)
    both = conditioned(prior(error_m=1.0, offset_m=4.0))
    assert isinstance(both, AveragedProcess)
    assert len(both.parts) == 2
    assert both.weights.sum() == pytest.approx(1.0)
    assert 0.0 < both.weights[1] < 0.5


def test_a_model_with_cells_comes_back_from_its_file(tmp_path: Path) -> None:
    made = partial(GaussianProcessTerrain, GaussianProcessConfig(), prior(), bounds=GRID.bounds)
    fitted = made(errors=ERRORS).fit(survey_points(60.0))
    fitted.save(tmp_path / "model.npz")
    back = GaussianProcessTerrain.load(tmp_path / "model.npz")
    for one, other in ((fitted.grid(GRID), back.grid(GRID)),):
        np.testing.assert_allclose(one.mean.elevation, other.mean.elevation, atol=1e-9)
        np.testing.assert_allclose(one.std.elevation, other.std.elevation, atol=1e-9)
