"""The field lattice below its lines of sight: the constrained optimum, gates, bounds, and what is kept."""

from pathlib import Path

import clarabel
import numpy as np
import pytest
from scipy import sparse

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.lattice.calibration import Scenes, hidden_from, imagined_sensors
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.field_posterior import Stiffness
from survey.reconstruction.lattice.solver import Ceiling, Operator, solve, solve_below
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.nodes import NodeWindow
from survey.reconstruction.terrain_map import MEASURED, RAY_BOUNDED

CRS = "EPSG:32608"
RAYS = FieldLatticeConfig(stiffness=20.0, range_m=8.0, rays=True)
BOUNDS = (-10.0, -10.0, 10.0, 10.0)
SENSOR = np.array([0.0, 0.0, 2.0])


def scan(xyz: FloatArray, sensor: FloatArray = SENSOR) -> SurfacePoints:
    return SurfacePoints(xyz, sigma_m=0.02, origins=np.broadcast_to(sensor, xyz.shape), crs=CRS)


def rings(n: int = 4000, seed: int = 0) -> FloatArray:
    """Gently rolling ground, seen from 3 m on, thinning out."""
    rng = np.random.default_rng(seed)
    r, a = 3.0 + 9.0 * rng.random(n) ** 2, rng.uniform(0.0, 2.0 * np.pi, n)
    x, y = r * np.cos(a), r * np.sin(a)
    z = 0.15 * np.sin(0.6 * x) * np.cos(0.5 * y) + 0.02 * rng.standard_normal(n)
    return np.column_stack([x, y, z])


def quadratic_programme(operator: Operator, rhs: FloatArray, ceiling: Ceiling) -> FloatArray:
    """Minimise with a slack for every node that has a ceiling, by an interior-point method."""
    n = rhs.size
    covered = np.flatnonzero(np.isfinite(ceiling.height).ravel())
    m = len(covered)
    yields = np.isfinite(ceiling.yield_m)
    # The slack v = q + l: quadratic up to where it yields, linear beyond (Huber's loss as a programme).
    hessian = sparse.block_diag([operator.dense(), ceiling.spring * np.eye(m), np.zeros((m, m))])
    linear = np.concatenate(
        [-rhs.ravel(), np.zeros(m), np.full(m, ceiling.spring * (ceiling.yield_m if yields else 1e3))]
    )
    pick = sparse.csc_matrix((np.ones(m), (np.arange(m), covered)), (m, n))
    one = sparse.identity(m)
    below = sparse.hstack([pick, -one, -one])
    positive = sparse.hstack([sparse.csc_matrix((m, n)), sparse.csc_matrix((m, m)), -one])
    rows = sparse.vstack(
        [below, positive, sparse.hstack([sparse.csc_matrix((m, n)), -one, sparse.csc_matrix((m, m))])]
    )
    limits = np.concatenate([ceiling.height.ravel()[covered], np.zeros(2 * m)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    solver = clarabel.DefaultSolver(
        sparse.triu(hessian).tocsc(),
        linear,
        rows.tocsc(),
        limits,
        [clarabel.NonnegativeConeT(3 * m)],
        settings,
    )
    return np.asarray(solver.solve().x)[:n].reshape(rhs.shape)


@pytest.mark.long
@pytest.mark.parametrize("yield_m", [np.inf, 0.06])
def test_the_constrained_optimum_is_that_of_a_quadratic_programme(yield_m: float) -> None:
    """On 30 x 30 nodes, with ceilings in a gap and ceilings that contradict the points."""
    rng = np.random.default_rng(5)
    data = np.zeros((1, 30, 30))
    measured = rng.random((30, 30)) < 0.3
    measured[8:20, 10:24] = False
    data[0][measured] = 400.0
    north, east = np.mgrid[:30, :30] * 0.25
    height = 0.4 * np.sin(east) * np.cos(0.7 * north)
    rhs = data[0] * height
    operator = Operator(data, Stiffness(20.0, 8.0).weights(0.25))
    free = solve(operator, rhs, np.zeros((30, 30)), tolerance=1e-9).z
    level = np.where(rng.random((30, 30)) < 0.4, free + rng.uniform(-0.3, 0.3, (30, 30)), np.inf)
    ceiling = Ceiling(level, 2500.0, yield_m)
    z = solve_below(operator, rhs, free, ceiling, tolerance=1e-10).z
    expected = quadratic_programme(operator, rhs, ceiling)
    assert (free > level).sum() > 50
    # The interior-point method stops at a relative gap of 1e-11 of an energy of some hundred.
    np.testing.assert_allclose(z, expected, rtol=0.0, atol=2e-5)


def test_a_surface_below_its_ceiling_is_left_alone() -> None:
    data = np.full((1, 12, 12), 10.0)
    operator = Operator(data, (1.0, 0.0, 0.0))
    rhs = data[0] * np.random.default_rng(0).random((12, 12))
    free = solve(operator, rhs, np.zeros((12, 12))).z
    below = solve_below(operator, rhs, free, Ceiling(free + 0.1, 100.0))
    assert below.n_iterations == 0
    assert np.array_equal(below.z, free)


def test_rays_bring_down_a_gap_that_the_points_would_bridge() -> None:
    """Two rims, and a level flight of rays through the valley between them."""
    y = np.linspace(-9.0, 9.0, 400)
    west, east = (np.column_stack([np.full(400, x), y, np.full(400, 1.0)]) for x in (-5.0, 5.0))
    feet = np.column_stack([np.zeros(400), y[::-1], np.zeros(400)])
    south = np.column_stack([np.linspace(-0.5, 0.5, 40), np.full(40, 9.5), np.full(40, 0.2)])
    xyz = np.concatenate([west, east, feet[np.abs(feet[:, 1]) > 8.0], south])
    sensor = np.array([0.0, -9.5, 1.2])
    free = FieldLattice(RAYS.model_copy(update={"rays": False, "gate": False}), BOUNDS).fit(scan(xyz, sensor))
    held = FieldLattice(RAYS.model_copy(update={"gate": False}), BOUNDS).fit(scan(xyz, sensor))
    places = np.array([[0.0, 0.0], [0.0, 3.0]])
    ceiling = 1.2 - 1.2 * (places[:, 1] + 9.5) / 19.0
    assert (free.predict(places) > ceiling + 0.1).all()
    # Margin of three standard deviations, 0.06 m, of the slope, and what the spring gives.
    assert (held.predict(places) < ceiling + 0.1).all()


def wall_of_hits() -> FloatArray:
    """Return the points of a wall 3 m high, 6 m east of the sensor."""
    y, z = np.meshgrid(np.linspace(-3.0, 3.0, 60), np.linspace(0.0, 3.0, 40))
    return np.column_stack([np.full(y.size, 6.0), y.ravel(), z.ravel()])


@pytest.mark.parametrize("is_seen", [True, False])
def test_a_wall_of_hits_does_not_carve_the_ground_before_it(is_seen: bool) -> None:
    """Ground that was measured stays, and ground that was not is left no lower than it is, at 0."""
    ground = rings()
    in_front = (ground[:, 0] > 3.4) & (np.abs(ground[:, 1]) < 3.0)
    ground[in_front, 2] = 0.0
    ground = ground[~in_front | is_seen]
    ground = ground[~((ground[:, 0] > 6.0) & (np.abs(ground[:, 1]) < 0.5 * ground[:, 0]))]
    points = scan(np.concatenate([ground, wall_of_hits()]))
    places = np.column_stack([np.linspace(3.5, 5.2, 12), np.zeros(12)])
    held = FieldLattice(RAYS, BOUNDS).fit(points).predict(places)
    free = FieldLattice(RAYS.model_copy(update={"rays": False}), BOUNDS).fit(points).predict(places)
    if is_seen:
        assert np.abs(held - free).max() < 0.02
    else:
        assert held.min() > -0.02
        assert (held <= free + 1e-3).all()


def test_a_single_ghost_moves_no_cell_beyond_a_metre_by_two_centimetres() -> None:
    ground = rings()
    ghost = np.concatenate([ground, [[6.0, 2.0, -10.0]]])
    with_it, without = (FieldLattice(RAYS, BOUNDS).fit(scan(xyz)) for xyz in (ghost, ground))
    away = np.hypot(*(with_it.where.window.xy - ghost[-1, :2]).T) > 1.0
    moved = np.abs(with_it._nodes() - without._nodes()).ravel()
    assert moved[away].max() < 0.02


def test_two_ghost_rays_that_no_gate_sees_leave_the_ceiling_as_it_is() -> None:
    """The third-lowest ray counts: rays with nothing beside their ends cannot be distinguished from others, but are outvoted."""
    window = NodeWindow.over(BOUNDS, 0.25)
    ground = rings()
    ghosts = np.array([[9.0, 3.0, -10.0], [9.0, 3.0, -9.0]])
    rays, alone = LowestRays.empty(window.shape), LowestRays.empty(window.shape)
    for target, xyz in ((alone, ground), (rays, ground), (rays, ghosts)):
        target.add(window, np.broadcast_to(SENSOR, xyz.shape), xyz, np.full(len(xyz), 0.02))
    level = np.zeros(window.shape)
    changed = rays.ceiling(level) < alone.ceiling(level)
    # What changes is the rank of the rays that were there: the ceiling comes down to the former lowest.
    assert (rays.ceiling(level)[changed] >= alone.height[0][changed] - 1e-9).all()


def test_rays_that_end_below_the_surface_do_not_carve() -> None:
    """A handful of returns by way of a mirror is no lone ghost, and its ends still lie too low."""
    ground = rings(8000)
    beside = np.flatnonzero(np.hypot(*(ground[:, :2] - [5.0, 0.0]).T) < 0.4)
    ground[beside[::4], 2] -= 1.0
    model = FieldLattice(RAYS.model_copy(update={"gate": False}), BOUNDS).fit(scan(ground))
    low = model._ends_low(model._accepted(scan(ground)))
    assert low[beside[::4]].all()
    # Around them the surface itself is pulled about, so that some good ends stand out too.
    assert low.mean() < 0.1


def test_bounds_enclose_the_map_and_the_ceiling_cuts_the_upper_one() -> None:
    model = FieldLattice(RAYS.model_copy(update={"calibrate": False}), BOUNDS).fit(scan(rings(800)))
    lower, upper = model._node_bounds()
    z = model._nodes()
    assert (lower <= z).all()
    assert (upper >= z).all()
    assert (upper <= np.maximum(model._ceiling(model._whole()), z)).all()
    support = model._node_support()
    assert set(np.unique(support)) >= {RAY_BOUNDED, MEASURED}


def test_rays_without_origins_are_refused() -> None:
    with pytest.raises(InputError, match="do not say where their sensor stood"):
        FieldLattice(RAYS, BOUNDS).fit(SurfacePoints(rings(100), sigma_m=0.02, crs=CRS))


def test_it_comes_back_from_its_file_and_goes_on_the_same(tmp_path: Path) -> None:
    first, second = scan(rings(800, 1)), scan(rings(800, 2))
    model = FieldLattice(RAYS, BOUNDS).fit(first)
    model.save(tmp_path / "map.npz")
    again = FieldLattice.load(tmp_path / "map.npz").update(second)
    model.update(second)
    for one, other in zip(model._node_bounds(), again._node_bounds(), strict=True):
        assert np.array_equal(one, other)


def scenes(points: FloatArray, surface: FloatArray, window: NodeWindow, measured: BoolArray) -> Scenes:
    return Scenes(points, window, surface, measured)


def test_what_an_imagined_sensor_does_not_see() -> None:
    """A ridge along y hides the ground behind it up to where the line over its crest comes down."""
    window = NodeWindow(0.5, -20, -4, 9, 41)
    x = window.xy[:, 0].reshape(window.shape)
    surface = np.where(np.abs(x) < 0.3, 1.0, 0.0)
    places = np.column_stack([np.arange(-9.0, 9.1, 0.5), np.zeros(37)])
    points = np.zeros((37, 7))
    points[:, :2] = places
    points[places[:, 0] == 0.0, 2] = 1.0
    world = scenes(points, surface, window, np.ones(window.shape, dtype=bool))
    hidden = hidden_from(np.array([-5.0, 0.0, 2.0]), 1.2, world)
    # Over the crest, 1 m high and 5 m away from a sensor at 2 m, the line meets the ground 5 m behind it.
    assert places[hidden, 0].tolist() == [-6.0, -5.5, -5.0, -4.5, -4.0, *np.arange(0.5, 5.0, 0.5)]


def test_imagined_sensors_stand_on_measured_ground_as_high_as_the_real_ones() -> None:
    window = NodeWindow.over(BOUNDS, 0.25)
    xyz = rings()
    points = np.column_stack([xyz, np.ones(len(xyz)), np.broadcast_to(SENSOR, xyz.shape)])
    measured = np.hypot(*window.xy.T).reshape(window.shape) > 3.0
    found = list(imagined_sensors(scenes(points, np.zeros(window.shape), window, measured)))
    assert len(found) == 6
    for place, blind_m in found:
        assert place[2] == pytest.approx(2.0)
        assert np.hypot(*place[:2]) > 3.0
        assert 3.0 <= blind_m < 3.5
