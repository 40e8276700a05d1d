"""The engine is chosen by the memory and the convergence that each one would have."""

import inspect
from typing import Any

import numpy as np
import pytest

from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.engine_choice import (
    EngineTask,
    choose_engine,
    condition_number,
    expected_error,
    fit_process,
)
from survey.reconstruction.gp.engines.fourier_basis import resolve_for_points
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.engines.fourier_weights import MeanSystem
from survey.reconstruction.gp.engines.local_gp import LocalGaussianProcess
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.kernels import Kernel, Matern32, SquaredExponential

SMOOTH, ROUGH = SquaredExponential(4.0, 5.0), Matern32(25.0, 20.0)


def task(kernel: Kernel, n: int, side_m: float, sigma_m: float, memory_mb: float) -> EngineTask:
    xy = np.random.default_rng(0).uniform(0.0, side_m, (n, 2))
    return EngineTask(kernel, xy, np.full(n, sigma_m**2), (0.0, 0.0, side_m, side_m), 1e-3, memory_mb)


@pytest.mark.parametrize(("n", "engine"), [(400, "dense"), (401, "fourier")])
def test_few_points_are_factorized_densely(n: int, engine: str) -> None:
    assert choose_engine(task(SMOOTH, n, 50.0, 0.1, 300.0)).engine == engine


def test_a_stated_dense_engine_is_taken_whatever_the_number_of_points() -> None:
    choice = choose_engine(task(SMOOTH, 5000, 50.0, 0.1, 300.0), is_dense=True)
    assert (choice.engine, choice.needed_mb) == ("dense", 400.0)


def test_less_memory_moves_the_choice_from_one_solve_to_tiles_to_neighbourhoods() -> None:
    choices = [choose_engine(task(SMOOTH, 1500, 400.0, 0.1, mb)) for mb in np.geomspace(12.0, 0.1, 14)]
    engines = [choice.engine for choice in choices]
    order = ["fourier", "tiled", "local"]
    assert engines == sorted(engines, key=order.index)
    assert set(engines) == set(order)
    for choice, memory_mb in zip(choices, np.geomspace(12.0, 0.1, 14), strict=True):
        if choice.engine != "local":  # whose one matrix of 256 neighbours fits always
            # Waves of equal strength are kept together: a few per cent more than stated.
            assert choice.needed_mb <= 1.05 * memory_mb
    n_tiles = [len(choice.tiles) for choice in choices if choice.tiles is not None]
    assert n_tiles == sorted(n_tiles)
    assert "do not fit" in choices[-1].reason


@pytest.mark.parametrize(("sigma_m", "engine"), [(0.1, "fourier"), (0.01, "local")])
def test_a_mean_that_cannot_converge_is_not_tried(sigma_m: float, engine: str) -> None:
    choice = choose_engine(task(ROUGH, 3000, 300.0, sigma_m, 5.0))
    assert choice.engine == engine
    assert ("cannot converge" in choice.reason) == (engine == "local")


@pytest.mark.parametrize(("sigma_m", "converges"), [(1.0, True), (0.01, False)])
def test_the_expected_error_separates_means_that_converge_from_those_that_do_not(
    sigma_m: float, converges: bool
) -> None:
    one = task(ROUGH, 3000, 300.0, sigma_m, 5.0)
    resolution = resolve_for_points(one.kernel, one.site, one.xy, one.noise_m2, **one.limits)
    assert resolution is not None
    z = 5.0 * np.sin(one.xy[:, 0] / 20.0)
    process = FourierGaussianProcess.solve(one.xy, z, np.sqrt(one.noise_m2), ROUGH, resolution=resolution)
    assert process.has_converged == converges
    assert (expected_error(one, resolution) < 0.05) == converges


def test_waves_that_the_covariance_holds_need_no_iterations() -> None:
    one = task(SMOOTH, 500, 50.0, 0.1, 300.0)
    resolution = resolve_for_points(one.kernel, one.site, one.xy, one.noise_m2, **one.limits)
    assert resolution is not None
    # The waves of the mean alone are weaker than the tolerance.
    assert condition_number(one, resolution) == pytest.approx(1.0, abs=0.1)
    assert expected_error(one, resolution) == 0.0


def test_a_mean_that_was_tried_and_did_not_converge_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    one = task(ROUGH, 3000, 300.0, 0.1, 5.0)
    assert choose_engine(one).engine == "fourier"
    z = np.random.default_rng(1).standard_normal(3000)
    config = GaussianProcessConfig(memory_mb=5.0)
    products = counted(monkeypatch, MeanSystem, "product")
    process, choice = fit_process(
        "gp", ROUGH, one.xy, z, np.sqrt(one.noise_m2), bounds=one.site, trend="none", config=config
    )
    assert isinstance(process, LocalGaussianProcess)
    assert "did not converge" in choice.reason
    # No more iterations are made than show that 200 of them would not do.
    assert 0 < len(products) < 100


def test_one_solve_that_did_not_do_is_not_tried_again_for_the_points_that_are_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    xy = np.random.default_rng(0).uniform(0.0, 300.0, (3000, 2))
    z = np.random.default_rng(1).standard_normal(3000)
    points = SurfacePoints(np.column_stack([xy, z]), sigma_m=0.1, crs="EPSG:32608")
    config = GaussianProcessConfig(
        fit=False,
        family="matern-3/2",
        variance_m2=25.0,
        length_scale_m=20.0,
        calibrate=True,
        memory_mb=5.0,
    )
    solves = counted(monkeypatch, FourierGaussianProcess, "solve")
    model = GaussianProcessTerrain(config).fit(points)
    assert model.learned_ is not None
    assert "did not converge" in model.learned_.choice.reason
    assert model.learned_.calibration.held_out["n_held_out"] > 300
    assert len(solves) == 1


def counted(monkeypatch: pytest.MonkeyPatch, owner: type, name: str) -> list[None]:
    """Return a list that grows by one with each call of a method, which is made as before."""
    calls: list[None] = []
    method = getattr(owner, name)

    def call(*arguments: Any, **named: Any) -> Any:
        calls.append(None)
        return method(*arguments, **named)

    monkeypatch.setattr(owner, name, staticmethod(call) if inspect.ismethod(method) else call)
    return calls


def test_the_choice_is_recorded_beside_the_name_of_the_engine() -> None:
    xy = np.random.default_rng(0).uniform(0.0, 50.0, (40, 2))
    points = SurfacePoints(np.column_stack([xy, np.sin(xy[:, 0] / 9.0)]), sigma_m=0.1, crs="EPSG:32608")
    config = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=20.0)
    model = GaussianProcessTerrain(config).fit(points)
    assert model.learned_ is not None
    engine = model.learned_.diagnostics()["engine"]
    assert engine["name"] == "DenseGaussianProcess"
    assert engine["reason"] == "there are no more than 400 points"
    assert engine["needed_mb"] == pytest.approx(2 * 8e-6 * 40**2)
