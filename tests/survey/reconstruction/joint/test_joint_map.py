"""Map and path as one estimate, on small worlds with known answers."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from survey import Dem, Grid, InputError, SurfacePoints
from survey.core.crs import projected_crs
from survey.core.transformation import transformed
from survey.data.path_error import PathError
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.engines.fourier_basis import amplitudes, resolve
from survey.reconstruction.gp.engines.regression import NoisyValues
from survey.reconstruction.gp.kernels import Matern32, SquaredExponential
from survey.reconstruction.gp.satellite_cells import SatelliteCells
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.normal_equations import Functionals, JointPosterior, waves_at
from survey.reconstruction.joint.shared_errors import SharedError, dominant_modes
from survey.reconstruction.joint.solution import JointMap
from survey.reconstruction.prior import SatelliteErrors
from survey.reconstruction.terrain_map import BEYOND

CRS = projected_crs("EPSG:32608", "the test")
GRID = Grid((0.0, 0.0, 200.0, 200.0), 20.0, CRS)
KNOWN = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=40.0, mean="plane")
WHITE = SatelliteErrors(product="unbiased", sigma_m=1.0).model()
TWO_M = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=0.1, datum_sigma_m=5.0))


def hill(xy: np.ndarray) -> np.ndarray:
    return 2.0 * np.sin(xy[:, 0] / 40.0) * np.cos(xy[:, 1] / 50.0) + 0.03 * xy[:, 0]


def path_error(sigma_m: float, drift: float = 0.0, angle_rad: float | None = None, n: int = 6) -> PathError:
    """Keyframes that share one error of place [m] and attitude [rad], and wander by a share `drift` of it each time."""
    size = 6 * n
    information = np.zeros((size, size))
    for axis in range(6):
        at = np.arange(n) * 6 + axis
        sigma = sigma_m if axis < 3 else (angle_rad or 0.005 * sigma_m)
        information[at[0], at[0]] += sigma**-2
        for a, b in itertools.pairwise(at):
            step = (max(drift, 1e-3) * sigma) ** -2
            information[np.ix_([a, b], [a, b])] += step * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return PathError(np.arange(n) * 20.0, sparse.csr_array(information), 6)


def seen_points(n: int = 300, lift_m: float = 0.0, seed: int = 1) -> SurfacePoints:
    """Landmarks beside a line to the east, 4 cm good, all lifted by what the path errs."""
    rng = np.random.default_rng(seed)
    keyframe = rng.uniform(0.0, 5.0, n)
    origin = np.column_stack([10.0 + 36.0 * keyframe, np.full(n, 100.0), np.zeros(n)])
    xy = origin[:, :2] + np.column_stack([rng.uniform(-5.0, 5.0, n), rng.uniform(-60.0, 60.0, n)])
    z = hill(xy) + lift_m + 0.04 * rng.standard_normal(n)
    origin[:, 2] = hill(origin[:, :2]) + lift_m
    own = np.tile(np.diag([1e-6, 1e-6, 0.04**2]), (n, 1, 1))
    return SurfacePoints(
        np.column_stack([xy, z]),
        covariance=own + np.eye(3),
        origins=origin,
        crs=CRS,
        own_covariance=own,
        keyframe=keyframe,
        heading_rad=np.zeros(n),
    )


def cells_of(height, offset_m: float = 0.0) -> Dem:
    """Means over cells of 50 m, by midpoints of 2.5 m."""
    fine = np.arange(1.25, 200.0, 2.5)
    x, y = np.meshgrid(fine, fine[::-1])
    z = height(np.column_stack([x.ravel(), y.ravel()])).reshape(4, 20, 4, 20).mean(axis=(1, 3))
    return Dem.on(Grid((25.0, 25.0, 175.0, 175.0), 50.0, CRS), z + offset_m)


def mapped(
    path: PathError, points: SurfacePoints, satellite: Dem | None = None, joint: JointConfig = TWO_M
) -> JointMap:
    return JointTerrain(path, satellite, KNOWN, joint).map(points, GRID)


def test_the_joint_solve_is_the_dense_inverse():
    rng = np.random.default_rng(0)
    kernel, n, n_shared = SquaredExponential(4.0, 40.0), 60, 10
    xy, sigma, z = rng.uniform(0.0, 200.0, (n, 2)), np.full(n, 0.1), rng.normal(size=n)
    basis = resolve(kernel, (0.0, 0.0, 200.0, 200.0), 0.05, tolerance_m=1e-3, memory_mb=50.0).covariance_basis
    strengths = amplitudes(kernel, basis)
    rows = sparse.csr_array(sparse.random(n, n_shared, 0.3, random_state=1, format="csr"))
    root = rng.normal(size=(n_shared, n_shared))
    prior = root @ root.T + np.eye(n_shared)
    cells = rng.normal(size=(4, basis.n_modes)) * 0.1
    more = Functionals(
        cells, sparse.csr_array(rng.normal(size=(4, n_shared))), rng.normal(size=4), 0.3 * np.eye(4)
    )
    information = sparse.csr_array(np.linalg.inv(prior))
    joint = JointPosterior.given(basis, strengths, NoisyValues.of(xy, z, sigma), (rows, information), more)

    waves = np.vstack([waves_at(xy, basis, strengths), cells])
    shared = np.vstack([rows.toarray(), more.shared.toarray()])
    noise = np.diag(np.concatenate([sigma**2, np.full(4, 0.3)]))
    inverse = np.linalg.inv(waves @ waves.T + shared @ prior @ shared.T + noise)
    values = np.concatenate([z, more.values])
    gain_u = prior @ shared.T @ inverse
    lower = np.tril_indices(basis.n_modes)
    # The bar of the method: 1e-8 in units of the prior standard deviation.
    np.testing.assert_allclose(joint.mean, waves.T @ inverse @ values, atol=1e-8)
    np.testing.assert_allclose(joint.shared, gain_u @ values, atol=1e-8)
    covariance = np.eye(basis.n_modes) - waves.T @ inverse @ waves
    np.testing.assert_allclose(joint.weights.covariance[lower], covariance[lower], atol=1e-8)
    every = sparse.csr_array(np.eye(n_shared))
    np.testing.assert_allclose(joint.shared_covariance(every), prior - gain_u @ shared @ prior, atol=1e-8)
    np.testing.assert_allclose(joint.cross_weights(every), -waves.T @ inverse @ shared @ prior, atol=1e-8)


def test_a_path_without_error_gives_the_plain_map():
    points = seen_points()
    own = replace(points, covariance=points.own_covariance)
    plain = reconstruct(own, GRID, config=KNOWN)
    independent = JointConfig(landmark_shared_sigma_m=0.0)
    joint = mapped(path_error(1e-6), points, joint=independent).reconstruction
    # The plain engine keeps more waves for its mean; both are within the tolerance asked for, 1 mm, of the exact map
    # near points, and of the standard deviation where it is a metre.
    far = plain.std.elevation > 0.5
    assert np.abs(joint.mean.elevation - plain.mean.elevation)[~far].max() < 3e-3
    assert np.abs(joint.std.elevation / plain.std.elevation - 1.0).max() < 0.02


def test_a_kernel_longer_than_the_site_draws_relief_that_points_show():
    points = seen_points(600)
    errors = []
    for kernel in (Matern32(4.0, 60.0), Matern32(4.0 * 10.0**3, 600.0)):
        config = GaussianProcessConfig(fit=False, kernel=kernel, mean="plane")
        terrain = JointTerrain(path_error(1e-3), None, config, JointConfig(memory_mb=10.0))
        height = terrain.solve(points, GRID.bounds).terrain.height(points.xy)
        errors.append(float(np.std(height - hill(points.xy))))
    # Near points both have the same steepness; the longer one's waves were too long for the hills before.
    assert errors[1] < 1.5 * errors[0]


def test_an_offset_that_all_landmarks_share_is_not_averaged_away():
    shared = mapped(path_error(1.0), seen_points(300)).reconstruction.std.elevation
    more = mapped(path_error(1.0), seen_points(600)).reconstruction.std.elevation
    plain = mapped(path_error(1e-6), seen_points(300)).reconstruction.std.elevation
    middle = GRID.shape[0] // 2
    # Along the path a metre is a metre, however many landmarks say so; independent ones claim centimetres.
    along = (middle, slice(1, -1))
    assert shared[along].min() > 0.99
    assert more[along].min() > 0.99
    assert plain[along].max() < 0.1


def test_the_satellite_determines_the_offset_of_the_path_and_the_path_that_of_the_satellite():
    exact = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=0.1))
    found = mapped(path_error(2.0), seen_points(lift_m=1.5), cells_of(hill), exact)
    # Sixteen cells of 10 cm, seen through landmarks on a fifth of the ground.
    np.testing.assert_allclose(found.correction.shift[:, 2], 1.5, atol=0.15)
    error = found.reconstruction.mean.elevation - hill(GRID.xy).reshape(GRID.shape)
    assert np.abs(error / found.reconstruction.std.elevation).max() < 4.0
    assert abs(error.mean()) < 0.15
    offset_map = mapped(path_error(0.01), seen_points(), cells_of(hill, offset_m=3.0)).reconstruction
    assert offset_map.diagnostics["satellite_offset_m"] == pytest.approx(3.0, abs=0.15)
    assert offset_map.diagnostics["satellite_offset_m_sigma"] < 0.15


def test_roll_tilts_what_lies_to_the_side():
    points = seen_points()
    roll = 0.02
    tilted = points.xyz.copy()
    assert points.origins is not None
    tilted[:, 2] += roll * (points.xyz[:, 1] - points.origins[:, 1])
    found = JointTerrain(
        path_error(0.02, angle_rad=0.05),
        cells_of(hill),
        KNOWN,
        JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=0.1)),
    )
    solution = found.solve(replace(points, xyz=tilted), GRID.bounds)
    roll_found = solution.posterior.shared[: 6 * 6].reshape(6, 6)[:, 5]
    # Cells of 10 cm over arms of 50 m.
    np.testing.assert_allclose(roll_found, roll, atol=0.004)


def test_the_order_of_landmarks_does_not_matter():
    points, path = seen_points(), path_error(0.5, 0.2)
    shuffled = points.select(np.random.default_rng(5).permutation(len(points)))
    one, other = (mapped(path, p, cells_of(hill)).reconstruction for p in (points, shuffled))
    # Sums in another order, through a factorization with a condition of 1e6.
    np.testing.assert_allclose(other.mean.elevation, one.mean.elevation, atol=1e-7)
    np.testing.assert_allclose(other.std.elevation, one.std.elevation, atol=1e-7)


def test_few_modes_of_the_path_come_close_to_all():
    points, path = seen_points(), path_error(0.5, 0.2)
    whole = mapped(path, points, cells_of(hill)).reconstruction
    gaps = []
    for rank in (1, 6, 35):
        few = mapped(path, points, cells_of(hill), TWO_M.model_copy(update={"rank": rank})).reconstruction
        gaps.append(float(np.abs(few.std.elevation - whole.std.elevation).max()))
    assert gaps[0] > gaps[1] > gaps[2]
    # 35 of 36 modes: what is left is millimetres of an error of half a metre.
    assert gaps[2] < 0.01


def test_modes_and_rest_make_up_every_landmarks_variance():
    points, path = seen_points(50), path_error(0.5, 0.2)
    slope = np.tile([0.05, -0.02], (50, 1))
    few = SharedError.dominant(points, path, slope, dominant_modes(path, 4))
    whole = np.diag(path.covariance(SharedError.full(points, path, slope).rows))
    np.testing.assert_allclose((few.rows.toarray() ** 2).sum(axis=1) + few.rest_m2, whole, rtol=1e-6)


def test_cells_are_means_and_not_their_centres():
    kernel = SquaredExponential(4.0, 40.0)
    basis = resolve(kernel, (0.0, 0.0, 200.0, 200.0), 0.05, tolerance_m=1e-3, memory_mb=50.0).covariance_basis
    strengths = amplitudes(kernel, basis)
    cells = SatelliteCells.of(cells_of(hill), CRS, GRID.bounds, WHITE)
    step = (np.arange(200) + 0.5) / 200.0 - 0.5
    u, v = np.meshgrid(step, step)
    within = cells.centre[5] + u.reshape(-1, 1) * cells.sides[5, 0] + v.reshape(-1, 1) * cells.sides[5, 1]
    by_hand = waves_at(within, basis, strengths).mean(axis=0)
    # The midpoint rule on 200 places a side, for waves of 20 m and longer over 50 m.
    np.testing.assert_allclose(cells.features(basis, strengths)[5], by_hand, atol=2e-5)


def test_cells_of_another_system_are_where_they_are():
    other = projected_crs("EPSG:32609", "the test")
    here = np.array([[500000.0, 6400000.0]])
    there = transformed(here, CRS, other, "the test")[0]
    dem = Dem.on(
        Grid((there[0] - 100.0, there[1] - 100.0, there[0] + 100.0, there[1] + 100.0), 50.0, other),
        np.zeros((5, 5)),
    )
    bounds = (here[0, 0] - 10.0, here[0, 1] - 10.0, here[0, 0] + 10.0, here[0, 1] + 10.0)
    cells = SatelliteCells.of(dem, CRS, bounds, WHITE)
    nearest = np.abs(cells.centre - here).sum(axis=1).argmin()
    np.testing.assert_allclose(cells.centre[nearest], here[0], atol=0.01)
    # Grid north of the two zones differs by some degrees, and the scale by a permille or two.
    np.testing.assert_allclose(np.linalg.norm(cells.sides[nearest], axis=1), 50.0, rtol=5e-3)
    assert abs(cells.sides[nearest, 0, 1]) > 1.0


def test_the_error_of_the_cells_is_found_when_it_is_not_stated():
    rng = np.random.default_rng(7)
    exact = cells_of(hill)
    noisy = Dem(exact.elevation + 0.8 * rng.standard_normal((4, 4)), exact.transform, CRS)
    white = JointConfig(satellite=SatelliteErrors(product="unbiased"))
    found = mapped(path_error(0.01), seen_points(), noisy, white).reconstruction.diagnostics
    # Some ten of the sixteen cells lie on landmarks: a standard deviation to 22 %, taken twice.
    assert 0.45 < found["satellite_sigma_m"] < 1.25
    found = mapped(path_error(0.01), seen_points(), noisy, JointConfig()).reconstruction.diagnostics
    assert 0.45 < np.hypot(found["satellite_sigma_m"], found["satellite_correlated_sigma_m"]) < 1.25


def test_one_call_gives_the_same_map():
    points, path = seen_points(), path_error(0.5, 0.2)
    called = reconstruct(points, GRID, cells_of(hill), config=KNOWN, path=path, joint=TWO_M)
    np.testing.assert_array_equal(
        called.mean.elevation, mapped(path, points, cells_of(hill)).reconstruction.mean.elevation
    )
    with pytest.raises(InputError, match="leave the path out"):
        reconstruct(points, GRID, method="tin", path=path)


def test_points_without_keyframes_are_refused():
    points = replace(seen_points(), keyframe=None)
    with pytest.raises(InputError, match="do not name the keyframes"):
        mapped(path_error(1.0), points)


def test_points_carry_their_keyframes_through_a_file(tmp_path):
    points = seen_points(20)
    points.write(tmp_path / "points.gpkg")
    back = SurfacePoints.read(tmp_path / "points.gpkg")
    for name in ("keyframe", "heading_rad", "own_covariance", "origins", "body"):
        np.testing.assert_array_equal(getattr(back, name), getattr(points, name))


def test_the_place_of_the_camera_on_the_body_does_not_move_the_joint_map():
    points = seen_points()
    raised = replace(points, origins=points.origins + [0.2, 0.0, 0.7])
    one, other = (mapped(path_error(0.5), p).reconstruction.mean.elevation for p in (points, raised))
    np.testing.assert_array_equal(one, other)


def test_landmarks_that_sink_alike_to_both_sides_do_not_bend_the_gaps():
    path, exact = path_error(0.02), seen_points(900)
    far = np.abs(exact.xy[:, 1] - 100.0)
    sunk = replace(exact, xyz=exact.xyz - np.radians(0.3) * far[:, None] * [0.0, 0.0, 1.0])
    beside = np.column_stack([np.tile(np.linspace(20.0, 180.0, 9), 2), np.repeat([15.0, 185.0], 9)])
    rmse, misfit = {}, {}
    for bow_deg in (0.0, 0.3):
        joint = JointConfig(satellite=TWO_M.satellite, bow_sigma_deg=bow_deg)
        solved = JointTerrain(path, None, KNOWN, joint).solve(sunk, GRID.bounds)
        error = solved.terrain.height(beside) - hill(beside)
        rmse[bow_deg] = float(np.sqrt(np.mean(error**2)))
        misfit[bow_deg] = float(np.mean(error**2 / np.diag(solved.terrain.covariance(beside))))
    # 85 m aside they are 0.45 m low. Swath and gaps look alike to a ridge, so that the bow is not found, but it is
    # claimed: twice what chance alone makes of 18 places that err together.
    assert misfit[0.3] < 2.0
    assert misfit[0.3] < 0.7 * misfit[0.0]
    assert rmse[0.3] < 1.1 * rmse[0.0]


def test_a_prior_forty_metres_too_high_loses_and_is_reported():
    points, path = seen_points(), path_error(0.5)
    without = mapped(path, points, None).reconstruction
    found = mapped(path, points, cells_of(hill, offset_m=40.0), JointConfig()).reconstruction
    assert len(found.diagnostics["prior_conflicts"]) == 1
    assert "m above the points" in found.diagnostics["prior_conflicts"][0]
    # The level is that of the points, to a fifth of the half metre that the path leaves open.
    error = found.mean.elevation - hill(GRID.xy).reshape(GRID.shape)
    level = without.mean.elevation - hill(GRID.xy).reshape(GRID.shape)
    along = GRID.shape[0] // 2
    assert abs(error[along].mean() - level[along].mean()) < 0.1


def test_a_stated_level_that_three_standard_deviations_contradict_counts_with_its_probability():
    # The path errs by 3.5 of its standard deviations, and the prior has the right level, as stated.
    path, stated = path_error(0.5), JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=0.1))
    found = mapped(path, seen_points(lift_m=1.75), cells_of(hill), stated)
    share = found.reconstruction.diagnostics["prior_level_probability"]
    assert 0.2 < share < 0.7
    assert (
        f"with a probability of {100.0 * share:.0f} %"
        in found.reconstruction.diagnostics["prior_conflicts"][0]
    )
    free = replace(found.solution, stated=None).on(GRID)
    error = found.reconstruction.mean.elevation - hill(GRID.xy).reshape(GRID.shape)
    along = GRID.shape[0] // 2
    assert np.all(np.abs(error[along]) < 2.0 * found.reconstruction.std.elevation[along])
    assert np.all(found.reconstruction.std.elevation[along] > free.reconstruction.std.elevation[along])
    up = np.sqrt(found.correction.covariance[:, 2, 2])
    assert np.all(np.abs(1.75 - found.correction.shift[:, 2]) < 2.0 * up)


def test_a_level_that_no_error_model_allows_is_not_used():
    stated = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=0.1))
    found = mapped(path_error(0.5), seen_points(), cells_of(hill, offset_m=40.0), stated)
    assert found.solution.stated is None
    assert "its level is not used" in found.reconstruction.diagnostics["prior_conflicts"][0]


def test_a_prior_that_agrees_is_no_conflict():
    found = mapped(path_error(0.5), seen_points(), cells_of(hill), JointConfig()).reconstruction
    assert found.diagnostics["prior_conflicts"] == []


def test_an_offset_of_the_prior_does_not_move_a_map_whose_path_has_its_level():
    points, path = seen_points(), path_error(0.1)
    error = {}
    for product in ("unknown", "unbiased"):
        joint = JointConfig(satellite=SatelliteErrors(product=product, sigma_m=0.1))
        found = mapped(path, points, cells_of(hill, offset_m=0.2), joint).reconstruction
        error[product] = float(np.abs(found.mean.elevation - hill(GRID.xy).reshape(GRID.shape)).mean())
    assert error["unknown"] < 0.6 * error["unbiased"]


def test_a_horizontal_shift_is_found_through_the_slope():
    def steep(xy: np.ndarray) -> np.ndarray:
        return hill(xy) + 0.3 * xy[:, 1] + 0.002 * (xy[:, 0] - 100.0) ** 2

    points = seen_points(600)
    lifted = replace(points, xyz=points.xyz + (steep(points.xy) - hill(points.xy))[:, None] * [0.0, 0.0, 1.0])
    fixed = replace(lifted, origins=None)
    east = cells_of(lambda xy: steep(xy - [6.0, 0.0]))
    exact = SatelliteErrors(product="unbiased", sigma_m=0.1, shift_sigma_m=5.0)
    wide = KNOWN.model_copy(update={"variance_m2": 100.0})
    solution = JointTerrain(path_error(0.02), east, wide, JointConfig(satellite=exact)).solve(
        replace(fixed, origins=points.origins), GRID.bounds
    )
    facts = solution.diagnostics()
    assert facts["satellite_shift_east_m"] == pytest.approx(
        6.0, abs=3.0 * facts["satellite_shift_east_m_sigma"]
    )
    assert facts["satellite_shift_east_m_sigma"] < 2.0


def test_a_fine_prior_is_used_in_blocks():
    fine = Grid((-39.0, -39.0, 239.0, 239.0), 2.0, CRS)
    rng = np.random.default_rng(4)
    heights = hill(fine.xy) + 0.3 * rng.standard_normal(len(fine.xy))
    joint = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=0.3))
    found = mapped(path_error(0.5), seen_points(), Dem.on(fine, heights.reshape(fine.shape)), joint)
    error = found.reconstruction.mean.elevation - hill(GRID.xy).reshape(GRID.shape)
    # 100 × 100 cells meet the site; blocks of 3 × 3 err by 0.1 m.
    assert found.reconstruction.diagnostics["satellite_sigma_m"] == pytest.approx(0.1)
    assert np.sqrt(np.mean(error**2)) < 0.1


def test_far_beyond_the_landmarks_the_joint_map_states_what_they_do_not_show() -> None:
    points, wide = seen_points(), Grid((0.0, -400.0, 200.0, 600.0), 50.0, CRS)
    about = Grid((20.0, 40.0, 180.0, 160.0), 20.0, CRS)
    model = JointTerrain(path_error(0.02), None, GaussianProcessConfig(family="matern-3/2"), TWO_M)
    near, far = (model.map(points, grid).reconstruction for grid in (about, wide))
    assert BEYOND not in near.diagnostics
    assert far.diagnostics[BEYOND]["farthest_m"] == pytest.approx(440.0, abs=5.0)
    claim = far.claim
    assert claim is not None
    assert claim.untested_share > 0.5
    # Ground that rises by 3 cm/m over the landmarks may do so, or turn, beyond them.
    assert far.std.at([[100.0, 590.0]])[0] > 0.03 * 400.0
    given = JointTerrain(path_error(0.02), None, KNOWN, TWO_M).map(points, wide).reconstruction
    assert BEYOND not in given.diagnostics
