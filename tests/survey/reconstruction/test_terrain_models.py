"""Every terrain model obeys one interface."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.spring_lattice import SpringLattice
from survey.reconstruction.methods.triangulation import TriangulatedTerrain
from survey.reconstruction.terrain_model import TerrainModel

CRS = "EPSG:32608"
PLACES = np.array([[5.0, 5.0], [2.2, 7.1], [8.9, 1.3]])

MODELS: dict[str, Callable[[], TerrainModel]] = {
    "gp": lambda: GaussianProcessTerrain(
        GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=3.0, mean="plane")
    ),
    "tin": TriangulatedTerrain,
    "emap": lambda: SpringLattice(SpringLatticeConfig(step_m=0.5, side_m=None, tolerance=1e-6)),
    "field": lambda: FieldLattice(
        FieldLatticeConfig(step_m=0.5, stiffness=200.0, range_m=10.0, tolerance=1e-6)
    ),
    "carving": lambda: SpaceCarvingKernel(SpaceCarvingConfig(carve=False)),
}


def points(up_m: float = 0.0, seed: int = 0) -> SurfacePoints:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 10.0, (300, 2))
    xy[:4] = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0]]
    z = 0.3 * np.sin(xy[:, 0]) + 0.1 * xy[:, 1] + up_m
    return SurfacePoints(np.column_stack([xy, z]), sigma_m=0.05, crs=CRS)


@pytest.fixture(params=MODELS)
def model(request: pytest.FixtureRequest) -> TerrainModel:
    return MODELS[request.param]()


def test_raising_every_point_raises_the_map_and_changes_nothing_else(model: TerrainModel) -> None:
    fitted = model.fit(points())
    low = fitted.predict(PLACES)
    std = fitted.predict(PLACES, "std") if model.capabilities.std else None
    raised = model.fit(points(1000.0))
    high = raised.predict(PLACES)
    # 1000 + z keeps 13 digits behind z; the solvers are good to 1e-6 of a standard deviation.
    np.testing.assert_allclose(high - 1000.0, low, atol=1e-6)
    if std is not None:
        np.testing.assert_allclose(raised.predict(PLACES, "std"), std, rtol=1e-5)


def test_what_cannot_be_asked_is_refused_in_one_sentence(model: TerrainModel) -> None:
    with pytest.raises(InputError, match="fit first"):
        model.predict(PLACES)
    fitted = model.fit(points())
    with pytest.raises(InputError, match="NaN"):
        fitted.predict([[np.nan, 0.0]])
    with pytest.raises(InputError, match="not known"):
        fitted.predict(PLACES, "colour")  # type: ignore[arg-type]
    if not fitted.capabilities.std:
        with pytest.raises(InputError, match="states no std"):
            fitted.predict(PLACES, "std")
    if not fitted.capabilities.samples:
        with pytest.raises(InputError, match="draw from"):
            fitted.sample(Grid((1.0, 1.0, 9.0, 9.0), 1.0, CRS), 1, np.random.default_rng(0))


def test_bounds_enclose_the_mean_and_support_is_a_code(model: TerrainModel) -> None:
    fitted = model.fit(points())
    assert set(fitted.predict(PLACES, "support")) <= {0.0, 1.0, 2.0, 3.0}
    if fitted.capabilities.std:
        mean, lower, upper = (fitted.predict(PLACES, what) for what in ("mean", "lower", "upper"))
        assert (lower < mean).all()
        assert (mean < upper).all()


def test_beyond_its_ground_a_model_is_silent_or_says_unseen(model: TerrainModel) -> None:
    fitted = model.fit(points())
    far = [[1e4, 1e4]]
    assert fitted.predict(far, "support") == 0.0
    if not isinstance(fitted, GaussianProcessTerrain):
        assert np.isnan(fitted.predict(far)).all()


def test_it_comes_back_from_its_file(model: TerrainModel, tmp_path: Path) -> None:
    fitted = model.fit(points()).update(points(seed=1))
    fitted.save(tmp_path / "model.npz")
    back = type(fitted).load(tmp_path / "model.npz")
    # The Gaussian process is conditioned again on all its points, where it was updated: 1e-5 of a length of 0.3 m.
    np.testing.assert_allclose(back.predict(PLACES), fitted.predict(PLACES), atol=1e-5)
    # And goes on from there as if it had never left.
    again = points(seed=2)
    np.testing.assert_allclose(
        back.update(again).predict(PLACES), fitted.update(again).predict(PLACES), atol=1e-5
    )
    (tmp_path / "bad.npz").write_bytes(b"no model")
    with pytest.raises(InputError, match="damaged"):
        type(fitted).load(tmp_path / "bad.npz")


def test_the_map_on_a_grid_is_what_is_predicted_at_its_nodes(model: TerrainModel) -> None:
    grid = Grid((2.0, 2.0, 8.0, 8.0), 2.0, CRS)
    fitted = model.fit(points())
    result = fitted.grid(grid)
    # The Gaussian process interpolates its waves on a grid to its tolerance of 1 mm.
    np.testing.assert_allclose(result.mean.elevation.ravel(), fitted.predict(grid.xy), atol=2e-3)
    np.testing.assert_array_equal(result.mean.shape, result.support.shape)
