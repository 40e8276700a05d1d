"""The field lattice: what it must get right whatever the ground."""

import os
import subprocess
import sys

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError, ConfigError, InputError
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.field_posterior import Stiffness
from survey.reconstruction.lattice.solver import Operator, Rim, VCyclePreconditioner, solve
from survey.reconstruction.line_of_sight.returns import ghosts
from survey.reconstruction.terrain_map import INTERPOLATED, MEASURED, UNSEEN

CRS = "EPSG:32608"
SQUARE = (0.0, 0.0, 9.5, 9.5)
FIXED = FieldLatticeConfig(
    step_m=0.5, stiffness=50.0, range_m=10.0, calibrate=False, tolerance=1e-8, gate=False
)


def scan(xyz: object, sigma_m: float = 0.05, origin: object = None) -> SurfacePoints:
    xyz = np.asarray(xyz, dtype=float)
    origins = None if origin is None else np.broadcast_to(np.asarray(origin, dtype=float), xyz.shape)
    return SurfacePoints(xyz, sigma_m=sigma_m, origins=origins, crs=CRS)


def hills(n: int, seed: int = 0, low: float = 0.0, high: float = 9.5) -> FloatArray:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(low, high, (n, 2))
    z = np.sin(0.7 * xy[:, 0]) * np.cos(0.5 * xy[:, 1])
    return np.column_stack([xy, z + 0.05 * rng.standard_normal(n)])


def field(bounds: tuple[float, float, float, float] | None = SQUARE, **changes: object) -> FieldLattice:
    return FieldLattice(FIXED.model_copy(update=changes), bounds)


def test_the_solution_is_that_of_the_dense_matrix() -> None:
    model = field().fit(scan(hills(60)))
    stencil, rhs = model.posterior.information.part(slice(0, 20), slice(0, 20))
    matrix = Operator(stencil, Stiffness(50.0, 10.0).weights(0.5)).dense()
    prior = Operator(np.zeros((1, 20, 20)), Stiffness(50.0, 10.0).weights(0.5))
    level, east, north = model.posterior.information.plane()
    j, i = np.mgrid[:20, :20]
    expected = np.linalg.solve(matrix, (rhs + prior.apply(level + east * i + north * j)).ravel())
    np.testing.assert_allclose(model.posterior.z.ravel(), expected, atol=1e-7)


def test_std_is_that_of_the_dense_inverse() -> None:
    model = field().fit(scan(hills(60)))
    operator = Operator(model.posterior.information.stencil, Stiffness(50.0, 10.0).weights(0.5))
    dense = np.sqrt(np.diag(np.linalg.inv(operator.dense())))
    exact = model.posterior.std(model.where.window, model.stiffness_)
    np.testing.assert_allclose(exact.ravel(), dense, rtol=1e-8)


def test_std_from_draws_agrees_with_the_exact_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("survey.reconstruction.lattice.field_posterior._EXACT_WORK", 0.0)
    model = field(n_draws=64).fit(scan(hills(60)))
    drawn = model.posterior.std(model.where.window, model.stiffness_)
    monkeypatch.undo()
    exact = model.posterior.std(model.where.window, model.stiffness_)
    # 64 draws: 9 % at one node; the mean over the map, whose errors are alike, within half of that.
    assert abs(float(np.mean(drawn / exact)) - 1.0) < 0.06
    assert (drawn / exact).min() > 0.5
    assert (drawn / exact).max() < 1.6


def test_a_plane_is_exact_in_gaps_and_beyond_the_points() -> None:
    xy = np.random.default_rng(2).uniform(0.0, 9.5, (300, 2))
    xy = xy[np.hypot(*(xy - 5.0).T) > 2.5]
    plane = np.column_stack([xy, 7.0 + 0.3 * xy[:, 0] - 0.2 * xy[:, 1]])
    model = field().fit(scan(plane))
    places = np.array([[5.0, 5.0], [4.0, 6.0], [0.0, 0.0], [9.5, 9.5]])
    # The plane is in neither the plate's energy nor the bed's; what is left is the solver's tolerance.
    np.testing.assert_allclose(
        model.predict(places), 7.0 + 0.3 * places[:, 0] - 0.2 * places[:, 1], atol=1e-6
    )


def test_batch_sequence_and_shuffle_agree() -> None:
    xyz = hills(400)
    batch = field().fit(scan(xyz)).posterior.z
    model = field()
    for part in np.array_split(xyz, 4):
        model.update(scan(part))
    shuffled = np.random.default_rng(5).permutation(xyz)
    np.testing.assert_allclose(model.posterior.z, batch, atol=1e-6)
    np.testing.assert_allclose(field().fit(scan(shuffled)).posterior.z, batch, atol=1e-6)


def test_a_growing_map_agrees_with_one_whose_bounds_were_known() -> None:
    first, second = hills(200, 1, 0.0, 4.0), hills(200, 2, 4.0, 9.5)
    grown = field(None).update(scan(first)).update(scan(second))
    fixed = field(grown.where.window.bounds).fit(scan(np.vstack([first, second])))
    np.testing.assert_allclose(
        grown.posterior.z + grown.where.datum_m, fixed.posterior.z + fixed.where.datum_m, atol=1e-6
    )


def test_a_window_solves_what_the_whole_map_solves() -> None:
    bounds = (-30.0, -30.0, 40.0, 40.0)
    xyz = hills(600)
    whole = field(bounds).fit(scan(xyz))
    window = field(bounds, window_nodes=64).fit(scan(xyz, origin=(5.0, 5.0, 2.0)))
    inside = np.random.default_rng(0).uniform(0.5, 9.0, (50, 2))
    # The rim stands on the plane, a range away from the points, where the whole map is within 2 mm of it.
    np.testing.assert_allclose(window.predict(inside), whole.predict(inside), atol=2e-3)
    np.testing.assert_allclose(window.settle().predict(inside), whole.predict(inside), atol=1e-6)


def test_a_node_seen_a_hundred_times_changes_its_variance_and_not_its_mean() -> None:
    xyz = hills(80)
    once = field().fit(scan(xyz))
    point = np.array([[4.0, 4.0, float(once.predict([[4.0, 4.0]])[0])]])
    often = field().fit(scan(np.vstack([xyz, np.repeat(point, 100, axis=0)])))
    # The added points lie on the surface; the best plane moves a little with them.
    np.testing.assert_allclose(often.predict([[4.0, 4.0]]), point[:, 2], atol=1e-3)
    assert often.predict([[4.0, 4.0]], "std") < 0.011
    assert once.predict([[4.0, 4.0]], "std") > 0.02


def test_twice_the_errors_and_twice_the_softness_double_the_std() -> None:
    places = [[4.0, 4.0], [8.0, 1.0]]
    one = field().fit(scan(hills(80)))
    two = field(stiffness=FIXED.stiffness / 4.0).fit(scan(hills(80), sigma_m=0.1))
    np.testing.assert_allclose(two.predict(places, "std"), 2.0 * one.predict(places, "std"), rtol=1e-8)
    np.testing.assert_allclose(two.predict(places), one.predict(places), atol=1e-6)


def test_one_ghost_moves_no_place_beyond_a_metre() -> None:
    xyz = hills(3000)
    ghost = np.vstack([xyz, [[5.0, 5.0, -10.0]]])
    clean, dirty = (field(gate=True).fit(scan(cloud)) for cloud in (xyz, ghost))
    places = clean.where.window.xy
    far = np.hypot(*(places - 5.0).T) > 1.0
    moved = np.abs(clean.predict(places) - dirty.predict(places))
    assert dirty.n_ghosts_ == 1
    assert moved[far].max() < 0.02


def test_the_top_of_a_pile_is_no_ghost() -> None:
    xy = np.random.default_rng(0).uniform(0.0, 10.0, (4000, 2))
    z = np.maximum(0.0, 1.5 - np.hypot(*(xy - 5.0).T))
    assert not ghosts(np.column_stack([xy, z])).any()


def test_a_rolling_map_leaves_no_mark_at_its_rear_edge() -> None:
    model = FieldLattice(FIXED.model_copy(update={"side_m": 8.0, "stiffness": 5.0}))
    rng = np.random.default_rng(4)
    for x in np.arange(0.0, 6.0, 0.75):
        xy = rng.uniform([x - 4.0, -4.0], [x + 4.0, 4.0], (900, 2))
        z = np.sin(0.8 * xy[:, 0])
        model.update(scan(np.column_stack([xy, z]), origin=(x, 0.0, 2.0)))
    nodes = model.where.window.xy
    error = model.predict(nodes) - np.sin(0.8 * nodes[:, 0])
    # Bilinear cells of 0.5 m bend by up to 0.8² · 0.5² / 8 = 2 cm; the rear edge is no worse than that.
    assert np.abs(error).max() < 0.05


def test_learning_finds_the_noise_and_predicts_held_out_ground() -> None:
    xyz = hills(4000)
    model = FieldLattice(FieldLatticeConfig(step_m=0.5)).fit(scan(xyz, sigma_m=0.1))
    # The points err by 0.05 m and say 0.1 m.
    assert 0.4 < model.stiffness_.noise_factor < 0.65
    places = np.random.default_rng(9).uniform(1.0, 8.5, (200, 2))
    error = model.predict(places) - np.sin(0.7 * places[:, 0]) * np.cos(0.5 * places[:, 1])
    z = error / model.predict(places, "std")
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.mean(np.abs(z) < 1.96) > 0.85


def test_edge_preserving_maps_have_sharper_edges() -> None:
    xy = np.random.default_rng(0).uniform(0.0, 9.5, (3000, 2))
    z = np.where(xy[:, 0] > 4.75, 1.0, 0.0) + 0.02 * np.random.default_rng(1).standard_normal(3000)
    cloud = scan(np.column_stack([xy, z]), sigma_m=0.02)
    places = np.column_stack([np.array([3.5, 4.0, 5.5, 6.0]), np.full(4, 5.0)])
    wanted = (places[:, 0] > 4.75).astype(float)
    stiff = {"stiffness": 2e4, "gate": False}
    soft = np.abs(field(**stiff).fit(cloud).predict(places) - wanted).max()
    sharp = np.abs(field(**stiff, edge_preserving=True).fit(cloud).predict(places) - wanted).max()
    assert sharp < 0.5 * soft


def test_support_separates_measured_between_and_unseen() -> None:
    model = field((-40.0, -40.0, 40.0, 40.0)).fit(scan(hills(400)))
    codes = model.predict([[5.0, 5.0], [-5.0, 5.0], [-35.0, 5.0], [99.0, 0.0]], "support")
    assert codes.tolist() == [MEASURED, INTERPOLATED, UNSEEN, UNSEEN]


def test_samples_have_the_posteriors_mean_and_spread() -> None:
    model = field().fit(scan(hills(60)))
    grid = Grid((0.0, 0.0, 9.0, 9.0), 1.5, CRS)
    drawn = model.sample(grid, 400, np.random.default_rng(0))
    mean, std = model.predict(grid.xy), model.predict(grid.xy, "std")
    # 400 draws: the mean to 5 % of a std (four of those allowed), the spread to 3.5 %.
    assert (np.abs(drawn.mean(axis=0).ravel() - mean) < 0.2 * std).all()
    np.testing.assert_allclose(drawn.std(axis=0).ravel(), std, rtol=0.2)


def test_the_v_cycle_is_symmetric_and_held_rims_stay() -> None:
    stencil = field().fit(scan(hills(60))).posterior.information.stencil
    operator = Operator(stencil, Stiffness(50.0, 10.0).weights(0.5))
    cycle = VCyclePreconditioner(operator, Rim(2, 0, 0, 2))
    a, b = np.random.default_rng(0).standard_normal((2, 20, 20))
    assert np.isclose(np.sum(a * cycle(b)), np.sum(b * cycle(a)), rtol=1e-10)
    start = np.random.default_rng(1).standard_normal((20, 20))
    z = solve(operator, b, start, preconditioner=cycle).z
    np.testing.assert_array_equal(z[:2], start[:2])
    np.testing.assert_array_equal(z[:, -2:], start[:, -2:])
    with pytest.raises(ValueError, match="shapes differ"):
        solve(operator, b[:19], start)


def test_all_points_at_one_spot_give_that_height() -> None:
    model = field(None).fit(scan(np.tile([[3.0, 3.0, 5.0]], (50, 1))))
    assert abs(model.predict([[3.0, 3.0]])[0] - 5.0) < 1e-6


def test_bad_input_gets_one_sentence() -> None:
    with pytest.raises(InputError, match="does not say where its sensor stood"):
        FieldLattice(FieldLatticeConfig(side_m=20.0)).fit(scan(hills(10)))
    with pytest.raises(CapacityError, match=r"take a step of 30\.3 m or more"):
        field(None).fit(scan([[0.0, 0.0, 0.0], [1e5, 1e5, 0.0]]))
    with pytest.raises(InputError, match="the map and the scan"):
        field().fit(scan(hills(10))).update(SurfacePoints(hills(10), sigma_m=0.1, crs="EPSG:32632"))
    with pytest.raises((ConfigError, ValueError), match="together"):
        FieldLatticeConfig(range_m=3.0)


DIGEST = """
import hashlib, numpy as np
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.data.surface_points import SurfacePoints
xy = np.random.default_rng(0).uniform(0.0, 12.0, (4000, 2))
xyz = np.column_stack([xy, np.sin(xy[:, 0])])
m = FieldLattice().fit(SurfacePoints(xyz, sigma_m=0.05, crs='EPSG:32608'))
z = np.concatenate([m.predict(xy), m.predict(xy, 'std')])
digest = hashlib.sha256(z.tobytes()).hexdigest()
print(digest)
"""


def test_same_bytes_whatever_the_number_of_threads() -> None:
    here: dict[str, str] = {}
    exec(DIGEST, here)  # the suite runs on one thread
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "4")
    done = subprocess.run(
        [sys.executable, "-c", DIGEST], env=os.environ | threads, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == here["digest"]
