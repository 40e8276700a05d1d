"""Memory and length scales of a map are checked before any work, and the message names the value that passes."""

import re

import numpy as np
import pytest

from survey.core.errors import CapacityError, InputError
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.families import Sum
from survey.reconstruction.gp.kernels import Matern32, SquaredExponential
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.spring_lattice import SpringLattice
from survey.reconstruction.mapping import reconstruct

GRID = Grid((0.0, 0.0, 40.0, 40.0), 2.0)


def some_points() -> SurfacePoints:
    xy = np.random.default_rng(1).uniform(0.0, 40.0, (60, 2))
    return SurfacePoints(np.column_stack([xy, 0.1 * xy[:, 0]]), sigma_m=0.05, crs="EPSG:32608")


def stated(**changes: object) -> GaussianProcessConfig:
    return GaussianProcessConfig.model_validate({"fit": False, "variance_m2": 4.0} | changes)


@pytest.mark.parametrize(
    "config",
    [
        stated(length_scale_m=1e-9),
        stated(kernel=Matern32(4.0, 1e-9)),
        stated(kernel=Sum(Matern32(4.0, 20.0), SquaredExponential(1.0, 1e-9))),
        stated(length_scale_m=20.0, anisotropy=1e9),
        stated(family="two-scale", length_scale_m=20.0, second_variance_m2=1.0, second_length_scale_m=1e-9),
        GaussianProcessConfig(length_scale_m=1e-9),
    ],
)
@pytest.mark.parametrize("method", ["gp", "dense"])
def test_a_length_scale_far_below_the_step_is_refused_with_the_smallest_that_passes(config, method):
    with pytest.raises(InputError, match=r"less than a hundredth of the map's step of 2 m.* 0\.02 m or more"):
        reconstruct(some_points(), GRID, method=method, config=config)


def test_a_kernel_object_with_a_length_scale_far_below_the_step_is_refused():
    with pytest.raises(InputError, match=r"set length_scale_m to 0\.02 m or more"):
        reconstruct(some_points(), GRID, kernel=Matern32(4.0, 1e-9))


def test_the_smallest_length_scale_that_is_named_passes():
    reconstruct(some_points(), GRID, config=stated(length_scale_m=0.02))


def named(pattern: str, error: object) -> float:
    found = re.search(pattern, str(error))
    assert found, str(error)
    return float(found[1])


@pytest.mark.parametrize(
    ("model", "config"),
    [
        (FieldLattice, FieldLatticeConfig(step_m=1e-9, memory_mb=1.0, n_draws=0)),
        (SpringLattice, SpringLatticeConfig(step_m=1e-9, side_m=None, memory_mb=1.0)),
    ],
)
def test_a_lattice_names_the_step_that_passes(model, config):
    with pytest.raises(CapacityError) as refusal:
        model(config).fit(some_points())
    step_m = named(r"take a step of (\S+) m or more", refusal.value)
    model(config.model_copy(update={"step_m": step_m})).fit(some_points())
    with pytest.raises(CapacityError):
        model(config.model_copy(update={"step_m": 0.9 * step_m})).fit(some_points())


@pytest.mark.parametrize("memory_mb", [1.0, 0.3])
def test_carving_names_the_length_scales_that_pass(memory_mb):
    config = SpaceCarvingConfig(carve=False, last_length_m=1e-9, memory_mb=memory_mb, n_epochs=2)
    with pytest.raises(CapacityError) as refusal:
        SpaceCarvingKernel(config).begin(some_points())
    last_m = named(r"set last_length_m = ([^ ,]+)", refusal.value)
    first_m = max(last_m, config.first_length_m)
    SpaceCarvingKernel(config.model_copy(update={"last_length_m": last_m, "first_length_m": first_m})).begin(
        some_points()
    )
    with pytest.raises(CapacityError):
        SpaceCarvingKernel(config.model_copy(update={"last_length_m": 0.9 * last_m})).begin(some_points())
