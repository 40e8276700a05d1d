"""Kernels by name, as objects, and as settings."""

from pathlib import Path

import numpy as np
import pytest

from survey.core.config import validated
from survey.core.errors import ConfigError
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.gp.families import (
    FAMILIES,
    SEARCHABLE,
    Sum,
    family_of,
    kernel_facts,
    kernel_from,
    kernel_of,
)
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.kernels import KINDS, Kernel, Matern32, RationalQuadratic, Whittle

CRS = "EPSG:32608"
GRID = Grid((0.0, 0.0, 40.0, 40.0), 4.0, CRS)


def points() -> SurfacePoints:
    xy = np.random.default_rng(0).uniform(0.0, 40.0, (80, 2))
    return SurfacePoints(np.column_stack([xy, np.sin(xy[:, 0] / 6.0)]), sigma_m=0.05, crs=CRS)


def test_every_family_has_a_kernel_of_its_name() -> None:
    for name, kind in KINDS.items():
        assert type(kernel_of(name, 2.0, 9.0)) is kind
        assert family_of(kernel_of(name, 2.0, 9.0)) == name
    assert set(SEARCHABLE) == {"squared-exponential", "matern-5/2", "matern-3/2", "whittle"}
    assert {"auto", "two-scale", "three-scale"} <= set(FAMILIES)


@pytest.mark.parametrize(
    "kernel",
    [
        Whittle(4.0, 25.0),
        RationalQuadratic(1.0, 10.0, 2.0, 30.0, shape=3.0),
        Sum(Matern32(4.0, 30.0), Whittle(0.2, 5.0)),
    ],
    ids=family_of,
)
def test_a_kernel_comes_back_from_its_facts(kernel: Kernel) -> None:
    assert kernel_from(kernel_facts(kernel)) == kernel


def test_a_kernel_object_its_name_and_its_settings_give_one_map() -> None:
    by_object = reconstruct(
        points(),
        GRID,
        kernel=Matern32(2.0, 12.0),
        config=GaussianProcessConfig(fit=False, kernel=Whittle(1.0, 1.0)),
    )
    by_name = reconstruct(
        points(),
        GRID,
        config=GaussianProcessConfig(fit=False, variance_m2=2.0, length_scale_m=12.0),
        kernel="matern-3/2",
    )
    table = {"fit": False, "kernel": {"family": "matern-3/2", "variance_m2": 2.0, "length_scale_m": 12.0}}
    by_table = reconstruct(points(), GRID, config=validated(GaussianProcessConfig, table, "the test"))
    for other in (by_name, by_table):
        np.testing.assert_array_equal(other.mean.elevation, by_object.mean.elevation)
    assert by_object.hyperparameters["family"] == "matern-3/2"


def test_a_fit_starts_from_the_kernel_and_keeps_its_family() -> None:
    result = reconstruct(points(), GRID, kernel=Sum(Matern32(1.0, 20.0), Whittle(0.1, 5.0)))
    assert result.hyperparameters["family"] == "sum"
    assert result.hyperparameters["length_scale_m_1"] != 20.0


def test_a_model_with_a_kernel_comes_back_from_its_file(tmp_path: Path) -> None:
    config = GaussianProcessConfig(fit=False, kernel=Whittle(2.0, 12.0))
    model = GaussianProcessTerrain(config).fit(points())
    model.save(tmp_path / "model.npz")
    places = np.array([[3.0, 4.0], [30.0, 20.0]])
    back = GaussianProcessTerrain.load(tmp_path / "model.npz")
    np.testing.assert_array_equal(back.predict(places), model.predict(places))


def test_what_is_no_kernel_is_refused() -> None:
    for table in ({"family": "cubic"}, {"family": "whittle"}, {"family": "sum", "parts": []}):
        with pytest.raises(ConfigError):
            validated(GaussianProcessConfig, {"kernel": table}, "the test")
    with pytest.raises(ConfigError, match="family of covariance functions"):
        reconstruct(points(), GRID, kernel="cubic")
    with pytest.raises(TypeError, match="the method tin has no kernel"):
        reconstruct(points(), GRID, method="tin", kernel="whittle")
