from dataclasses import replace

import numpy as np
import pytest

from survey import InputError
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import Barometer, GpsFixes, Inertial
from vision_slam import LocalizationConfig, localize
from vision_slam.attitude import rotations, turned
from vision_slam.fusion.smoother import SmoothedPath, node_spacing_m, smooth
from vision_slam.motion import dead_reckoning

CRS = "EPSG:32608"


def circle(n: int = 400, radius_m: float = 60.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and attitudes of a drive around a circle, 1 m each second, with some climb."""
    angle = np.arange(n) / radius_m
    height = 3.0 * np.sin(angle)
    position = np.column_stack([radius_m * np.sin(angle), radius_m * (1 - np.cos(angle)), height])
    attitude = np.column_stack([0.05 * np.sin(angle), -np.arctan(3.0 * np.cos(angle) / radius_m), angle])
    return np.arange(n, dtype=float), position, attitude


def odometry_of(time_s, position, attitude) -> Odometry:
    steps = np.einsum("nji,nj->ni", rotations(attitude[:-1]), np.diff(position, axis=0))
    return Odometry(time_s, steps, attitude)


def test_odometry_without_any_motion_is_refused():
    standing = Odometry(np.arange(5.0), np.zeros((4, 3)), np.zeros((5, 3)))
    fixes = GpsFixes(np.arange(5.0), np.column_stack([np.arange(5.0), np.zeros((5, 2))]))
    sightings = Sightings([3], [[4.0, 0.0, 0.0]], [np.eye(3) * 0.01], [4.0])
    recording = Recording(CRS, np.zeros(3), gps=fixes, odometry=standing, sightings=sightings)
    with pytest.raises(InputError, match="measures no motion from the first to the last of 5 poses; record"):
        localize(recording)


def test_dead_reckoning_of_exact_odometry_is_the_path():
    time_s, position, attitude = circle()
    # Sums of 400 rounded steps.
    np.testing.assert_allclose(
        dead_reckoning(odometry_of(time_s, position, attitude), position[0]), position, atol=1e-9
    )


def test_attitude_errors_answer_as_the_jacobian_says():
    _, _, attitude = circle()
    arm_body = np.array([3.0, -2.0, 0.5])
    level = attitude * [0.0, 0.0, 1.0]
    by_yaw, by_pitch = turned(rotations(level) @ arm_body, level[:, 2])
    small = 1e-6
    for axis, answer in ((2, by_yaw), (1, by_pitch)):
        moved = rotations(level + small * np.eye(3)[axis]) @ arm_body
        # Forward differences of rotations: second order, 1e-6 of a few metres.
        np.testing.assert_allclose((moved - rotations(level) @ arm_body) / small, answer, atol=1e-5)


def test_exact_records_leave_the_path_where_it_is():
    time_s, position, attitude = circle()
    odometry = odometry_of(time_s, position, attitude)
    barometer = Barometer(time_s, position[:, 2] + 500.0)
    recording = Recording(
        CRS, position[0], GpsFixes(time_s, position), odometry=odometry, barometer=barometer
    )
    path = smooth(recording, dead_reckoning(odometry, position[0]), LocalizationConfig())
    np.testing.assert_allclose(path.position, position, atol=1e-6)
    np.testing.assert_allclose(path.attitude_rad, attitude, atol=1e-6)


def test_what_was_read_after_the_last_pose_does_not_pull_the_path():
    time_s, position, attitude = circle()
    odometry = odometry_of(time_s[:200], position[:200], attitude[:200])
    barometer = Barometer(time_s, position[:, 2] + 500.0)
    recording = Recording(
        CRS, position[0], GpsFixes(time_s, position), odometry=odometry, barometer=barometer
    )
    path = smooth(recording, dead_reckoning(odometry, position[0]), LocalizationConfig())
    # The reading of the second after the last pose counts as of that pose, 1 m further on, among ten at the node.
    np.testing.assert_allclose(path.position, position[:200], atol=0.1)


def test_scale_error_is_found_by_gps():
    time_s, position, attitude = circle(1200)
    odometry = odometry_of(time_s, position, attitude)
    stretched = Odometry(time_s, odometry.step * 1.004, odometry.attitude_rad)
    recording = Recording(CRS, position[0], GpsFixes(time_s, position), odometry=stretched)
    config = LocalizationConfig(gps_bias_sigma_m=0.02, gps_white_sigma_m=0.02)
    reckoned = dead_reckoning(stretched, position[0])
    before = np.abs(reckoned - position).max()
    after = np.abs(smooth(recording, reckoned, config).position - position).max()
    # The odometry alone is off by 0.4 % of the circle's width; GPS of 3 cm leaves centimetres.
    assert before > 0.4
    assert after < 0.05


def test_uncertainty_grows_without_gps_and_is_small_at_the_surveyed_start():
    time_s, position, attitude = circle(1000)
    odometry = odometry_of(time_s, position, attitude)
    only_two = GpsFixes(time_s[:2], position[:2])
    recording = Recording(CRS, position[0], only_two, odometry=odometry)
    path = smooth(recording, dead_reckoning(odometry, position[0]), LocalizationConfig())
    sigma = np.sqrt(np.trace(path.covariance[:, :3, :3], axis1=1, axis2=2))
    assert sigma[0] == pytest.approx(0.02 * np.sqrt(3), rel=0.01)
    # 1 km with 0.4 % scale error around a circle of 120 m width, 6 mm per root metre, tilt 0.1°.
    assert 0.3 < sigma[-1] < 3.0


def sighted(time_s, position, attitude, sightings):
    odometry = odometry_of(time_s, position, attitude)
    return Recording(CRS, position[0], GpsFixes(time_s, position), odometry=odometry, sightings=sightings)


def test_no_landmark_through_the_gates_is_refused():
    time_s, position, attitude = circle(50)
    sightings = Sightings([3], [[4.0, 0.0, 0.0]], [np.eye(3) * 0.01], [4.0])
    recording = sighted(time_s, position, attitude, sightings)
    with pytest.raises(InputError, match="none of 1 landmarks"):
        localize(recording)


def test_images_without_any_landmark_end_with_what_to_do():
    time_s, position, attitude = circle(20)
    sightings = Sightings(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    with pytest.raises(InputError, match=r"no landmark could be placed.*localize the file of fixes alone"):
        localize(sighted(time_s, position, attitude, sightings))


def test_recording_gives_itself_back(tmp_path):
    time_s, position, attitude = circle(20)
    odometry = odometry_of(time_s, position, attitude)
    sightings = Sightings([3], [[4.0, 1.0, 0.0]], [np.diag([1.0, 2.0, 3.0])], [4.0])
    barometer = Barometer(time_s, position[:, 2])
    recording = Recording(
        CRS,
        position[0],
        GpsFixes(time_s, position),
        odometry=odometry,
        barometer=barometer,
        sightings=sightings,
        antenna_height_m=0.5,
        vertical_datum="EGM96 height",
    )
    recording.write(tmp_path / "r")
    back = Recording.read(tmp_path / "r")
    np.testing.assert_array_equal(back.odometry.step, odometry.step)
    np.testing.assert_array_equal(back.sightings.covariance, sightings.covariance)
    np.testing.assert_array_equal(back.gps.position, position)
    assert (back.antenna_height_m, back.vertical_datum) == (0.5, "EGM96 height")
    with pytest.raises(InputError, match="not empty"):
        recording.write(tmp_path / "r")


def test_sightings_must_belong_to_poses():
    time_s, position, attitude = circle(20)
    sightings = Sightings([20], [[4.0, 1.0, 0.0]], [np.eye(3)], [4.0])
    with pytest.raises(InputError, match="outside 0 … 19"):
        sighted(time_s, position, attitude, sightings)


def test_gravity_says_nothing_new_of_an_odometry_that_it_levelled():
    """Jolted readings tilt a path whose odometry came level by other means, and none that they levelled themselves."""
    time_s, position, attitude = circle()
    odometry = odometry_of(time_s, position, attitude)
    up = np.einsum("nji,j->ni", rotations(attitude), [0.0, 0.0, 9.81])
    jolts = 0.3 * np.random.default_rng(1).standard_normal((len(time_s), 3))
    inertial = Inertial(time_s, np.zeros((len(time_s), 3)), up + jolts)
    recording = Recording(CRS, position[0], GpsFixes(time_s, position), odometry=odometry, inertial=inertial)
    reckoned = dead_reckoning(odometry, position[0])
    other = smooth(recording, reckoned, LocalizationConfig())
    levelled = smooth(recording, reckoned, LocalizationConfig(levelling_sigma_deg=0.15))
    # An exact odometry stays as it is, to rounding; jolts of 1.8 degrees, ten a node, tilt the other by a tenth.
    np.testing.assert_allclose(levelled.attitude_rad[:, :2], attitude[:, :2], atol=1e-6)
    assert np.degrees(np.abs(other.attitude_rad[:, :2] - attitude[:, :2]).max()) > 0.03
    # What it claims is no less than without an accelerometer.
    roll = levelled.covariance[:, 5, 5]
    assert (roll >= (1.0 - 1e-6) * smooth_without(recording, reckoned).covariance[:, 5, 5]).all()


def smooth_without(recording: Recording, reckoned: np.ndarray) -> SmoothedPath:
    return smooth(replace(recording, inertial=None), reckoned, LocalizationConfig())


def test_nodes_lie_closer_where_fixes_are_more_precise_than_a_varying_scale() -> None:
    exact = LocalizationConfig(gps_white_sigma_m=0.02)
    assert node_spacing_m(100.0, exact) == exact.node_spacing_m  # a constant scale, from a surveyed start
    # Over half the spacing, steps of 6 mm/√m vary by half of 2 cm.
    unknown = exact.model_copy(update={"start": "unknown"})
    assert node_spacing_m(100.0, unknown) == pytest.approx(0.5 * 0.02**2 / 0.006**2)
    images = exact.model_copy(update=exact.images.model_dump())
    assert node_spacing_m(100.0, images) < 0.1
    assert node_spacing_m(2700.0, images) == 2700.0 / 2000.0
    usual = images.model_copy(update={"gps_white_sigma_m": 0.5})
    assert node_spacing_m(100.0, usual) == usual.node_spacing_m


def test_unmeasured_steps_after_a_rest_leave_all_variances_positive():
    time_s, position, attitude = circle(300)
    rest = 4
    times = np.arange(len(time_s) + rest, dtype=float)
    position, attitude = (np.concatenate([np.tile(a[:1], (rest, 1)), a]) for a in (position, attitude))
    moved = odometry_of(times, position, attitude)
    sigma = np.zeros(len(times) - 1)
    sigma[rest : rest + 12] = 0.02
    odometry = replace(moved, step_sigma_m=sigma)
    recording = Recording(CRS, position[0], GpsFixes(times, position), odometry=odometry)
    path = smooth(recording, dead_reckoning(odometry, position[0]), LocalizationConfig(start="surveyed"))
    assert path.error.time_s[1] <= rest  # a node at the end of the rest, without any travel
    assert (np.einsum("nii->ni", path.covariance) > 0.0).all()
    alone = path.error.pose_covariances[0]
    nodes = np.searchsorted(times, path.error.time_s)
    np.testing.assert_allclose(path.covariance[nodes], alone, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("spacing_m", [10.0, 2.0])
def test_turns_have_more_nodes_where_tilt_errors_stay_in_the_world(spacing_m):
    time_s, position, attitude = circle(200, radius_m=5.0)
    odometry = odometry_of(time_s, position, attitude)
    recording = Recording(CRS, position[0], GpsFixes(time_s, position), odometry=odometry)
    counts = [
        len(smooth(recording, dead_reckoning(odometry, position[0]), config).error)
        for config in (
            LocalizationConfig(node_spacing_m=spacing_m),
            LocalizationConfig(node_spacing_m=spacing_m, tilt_stays_in_world=True),
        )
    ]
    # 40 rad in all, with half a node each, however close the nodes for travel are.
    assert counts[1] - counts[0] == pytest.approx(20, abs=1)


def test_attitude_errors_of_images_stay_in_the_world():
    assert LocalizationConfig().with_image_errors().tilt_stays_in_world
    assert not LocalizationConfig().tilt_stays_in_world
