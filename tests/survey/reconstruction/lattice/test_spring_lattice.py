"""EMap in its sound reading, and the literal one that fails."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.config import SpringLatticeConfig
from survey.reconstruction.lattice.spring_lattice import SpringLattice, nearest_nodes
from survey.reconstruction.nodes import NodeWindow

CRS = "EPSG:32608"


def scan(xyz: object, origin: tuple[float, float, float] | None = None) -> SurfacePoints:
    xyz = np.asarray(xyz, dtype=float)
    origins = None if origin is None else np.broadcast_to(origin, xyz.shape)
    return SurfacePoints(xyz, sigma_m=0.05, origins=origins, crs=CRS)


def lattice(**changes: object) -> SpringLattice:
    values: dict[str, object] = {"step_m": 0.5, "side_m": None, "tolerance": 1e-8}
    return SpringLattice(SpringLatticeConfig.model_validate(values | changes))


FRAME = [[x, y, 0.0] for x in (0.0, 4.0) for y in (0.0, 4.0)]


def test_an_empty_node_between_filled_ones_moves() -> None:
    model = lattice().fit(scan(FRAME))
    model.update(scan([[1.0, 2.0, 1.0], [3.0, 2.0, 1.0]]))
    assert model.predict([[2.0, 2.0]])[0] > 0.1


def test_the_printed_diagonal_matrix_moves_no_node_without_points() -> None:
    # Eq. 3 with its diagonal stiffness: displacement² = K_d d² / K_s, node by node; a gap stays where it was.
    squared = np.array([0.0, 1.0, 0.0])
    stiffness = np.diag([2.0, 2.0, 2.0])
    assert np.linalg.solve(stiffness, squared)[[0, 2]].tolist() == [0.0, 0.0]


def test_the_displacement_balances_all_springs() -> None:
    rng = np.random.default_rng(3)
    xyz = np.column_stack([rng.uniform(0, 4, (40, 2)), rng.normal(size=40)])
    model = lattice().fit(scan(FRAME))
    before = model.z_.copy()
    model.update(scan(xyz))
    window = model.where.window
    node, _ = nearest_nodes(window, xyz[:, :2])
    displacement = model.z_ - before
    laplacian = np.zeros_like(before)
    for axis in (0, 1):
        step = np.diff(displacement, axis=axis)
        widths = [(0, 0), (0, 0)]
        widths[axis] = (1, 1)
        laplacian -= np.diff(np.pad(step, widths), axis=axis)
    count = np.bincount(node, minlength=before.size).reshape(before.shape)
    pull = np.bincount(node, xyz[:, 2] - model.where.datum_m - before.ravel()[node], before.size)
    np.testing.assert_allclose(
        laplacian + 0.5 * count * displacement, 0.5 * pull.reshape(before.shape), atol=1e-6
    )


def test_rounding_finds_the_node_that_the_kd_tree_finds() -> None:
    window = NodeWindow(0.25, -8, 4, 20, 30)
    xy = np.random.default_rng(0).uniform([-2.0, 1.0], [5.2, 5.7], (500, 2))
    node, inside = nearest_nodes(window, xy)
    assert inside.all()
    np.testing.assert_array_equal(node, cKDTree(window.xy).query(xy)[1])


def test_a_lattice_that_does_not_cover_the_range_warns() -> None:
    far = [[x, 0.0, 0.0] for x in np.linspace(-10.0, 10.0, 41)]
    with pytest.warns(UserWarning, match="does not cover the sensor's range"):
        lattice(side_m=10.0).fit(scan(far, (0.0, 0.0, 2.0)))


def test_the_lattice_follows_the_sensor_by_whole_steps_and_remembers() -> None:
    model = lattice(side_m=8.0)
    rng = np.random.default_rng(1)
    xy = rng.uniform(-3.0, 3.0, (400, 2))
    model.fit(scan(np.column_stack([xy, 0.2 * xy[:, 0]]), (0.0, 0.0, 2.0)))
    before = model.predict([[2.0, 0.0]])
    # A point on the surface pulls at nothing.
    model.update(scan([[3.0, 0.0, model.predict([[3.0, 0.0]])[0]]], (1.3, 0.0, 2.0)))
    assert model.where.window.west == -8 + 3
    np.testing.assert_allclose(model.predict([[2.0, 0.0]]), before, atol=1e-9)


def test_a_following_lattice_needs_the_sensors_place() -> None:
    with pytest.raises(InputError, match="does not say where its sensor stood"):
        lattice(side_m=8.0).fit(scan(FRAME))
