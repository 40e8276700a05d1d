"""Every method of the registry maps points by the one call, with its own settings."""

import numpy as np
import pytest

from survey.core.config import Section, validated
from survey.core.errors import ConfigError, InputError
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.registry import METHODS, ReconstructionConfig, method_named

CRS = "EPSG:32608"
GRID = Grid((1.0, 1.0, 9.0, 9.0), 0.5, CRS)
SETTINGS: dict[str, Section] = {
    "gp": GaussianProcessConfig(fit=False, variance_m2=1.0, length_scale_m=3.0),
    "dense": GaussianProcessConfig(fit=False, variance_m2=1.0, length_scale_m=3.0),
    "field": FieldLatticeConfig(stiffness=200.0, range_m=10.0),
    "emap": SpringLatticeConfig(k_data=1.0),
    "carving": SpaceCarvingConfig(n_epochs=4),
}


def points() -> SurfacePoints:
    xy = np.random.default_rng(0).uniform(0.0, 10.0, (1500, 2))
    xyz = np.column_stack([xy, 0.1 * xy[:, 1]])
    return SurfacePoints(xyz, sigma_m=0.05, origins=np.tile([5.0, 5.0, 9.0], (len(xy), 1)), crs=CRS)


@pytest.mark.parametrize("name", [name for name in METHODS if not METHODS[name].needs_path])
def test_every_method_maps_a_plane_by_name(name: str) -> None:
    result = reconstruct(points(), GRID, method=name, config=SETTINGS.get(name))
    assert result.method == name
    plane = 0.1 * GRID.xy[:, 1].reshape(GRID.shape)
    assert np.nanmax(np.abs(result.mean.elevation - plane)) < 0.1


def test_a_lattice_takes_the_step_of_the_map_unless_its_own_is_stated() -> None:
    assert reconstruct(points(), GRID, method="field").diagnostics["step_m"] == 0.5
    fine = FieldLatticeConfig(step_m=0.25)
    assert reconstruct(points(), GRID, method="field", config=fine).diagnostics["step_m"] == 0.25


def test_the_joint_map_without_a_path_is_refused() -> None:
    with pytest.raises(InputError, match=r"needs the error that the points share.*none was given"):
        reconstruct(points(), GRID, method="joint")


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"method": "kriging"}, "take one of gp, joint, dense, tin, field, emap, carving"),
        ({"method": "emap", "rays": True}, "uses no lines of sight; take field or carving"),
        ({"method": "field", "value": "temperature_c"}, "maps elevations"),
    ],
)
def test_what_a_method_lacks_is_named_with_the_methods_that_have_it(
    settings: dict[str, object], word: str
) -> None:
    with pytest.raises(InputError, match=word):
        reconstruct(points(), GRID, **settings)  # type: ignore[arg-type]


def test_settings_of_another_method_are_a_type_error() -> None:
    with pytest.raises(TypeError, match="the method field takes FieldLatticeConfig"):
        reconstruct(points(), GRID, method="field", config=GaussianProcessConfig())


def test_the_settings_of_a_map_have_a_section_for_every_method() -> None:
    config = ReconstructionConfig()
    for method in METHODS.values():
        assert set(config.configs_of(method).by_class) == set(method.configs.values())
    assert method_named("joint").needs_path


def test_a_method_that_is_not_known_is_refused_in_settings() -> None:
    with pytest.raises(ConfigError, match=r"method.*gp, joint, dense"):
        validated(ReconstructionConfig, {"method": "kriging"}, "the test")
