"""One entry to localization: the same steps for every recording, in API and command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from tests.vision_slam.conftest import PlaneWorld
from vision_slam import LocalizationConfig, localize
from vision_slam.agreement.drive import measure_motion
from vision_slam.attitude import rotations
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.places.relocalization import align_heading
from vision_slam.recordings import open_recording, read_sequence

UTM = "EPSG:32608"
STEP_M, N = 0.5, 48
HEADING = np.radians(30.0)


@pytest.fixture(scope="module")
def walk(plane_world: object, camera: Camera) -> Recording:
    """Forty-eight images 0.5 m apart, heading 30° north of east, a fix of 0.1 m at each, no wheels."""
    pose, images = np.eye(4), []
    for k in range(N):
        pose[0, 3] = 0.25 * STEP_M * k
        images.append(plane_world.image(pose))  # type: ignore[attr-defined]
    along = STEP_M * np.arange(N)
    place = np.column_stack([along * np.cos(HEADING), along * np.sin(HEADING), np.zeros(N)])
    place += [500000.0, 6470000.0, 50.0] + np.random.default_rng(2).normal(0.0, 0.1, (N, 3))
    times = 0.25 * np.arange(N)
    return Recording(
        UTM, place[0], GpsFixes(times, place), camera=camera, frames=Frames(times, images), start_is_surveyed=False
    )  # fmt: skip


@pytest.fixture(scope="module")
def visual(walk: Recording) -> VisualOdometry:
    return visual_odometry(walk)


@pytest.mark.long
def test_images_without_wheels_are_scaled_by_the_fixes(walk: Recording, visual: VisualOdometry) -> None:
    result = localize(walk, visual=visual)
    # 48 fixes of 0.1 m place the ends to centimetres; 0.5 m is what the errors assumed of the fixes allow.
    assert np.linalg.norm((result.trajectory.position - walk.gps.position)[-1, :2]) < 0.5
    assert result.trajectory.length_m == pytest.approx(STEP_M * (N - 1), rel=0.03)
    assert result.n_fixes == N
    assert any("offset between the clocks" in note for note in result.notes)  # straight on at constant speed
    # Images that are processed on the way give the same bytes.
    again = localize(walk)
    assert again.visual_odometry is not None
    assert result.trajectory.position.tobytes() == again.trajectory.position.tobytes()
    assert result.points.xyz.tobytes() == again.points.xyz.tobytes()


def test_fixes_that_hardly_move_are_refused_before_any_image_is_read(walk: Recording) -> None:
    class Unread:
        def __getitem__(self, index: int) -> None:
            pytest.fail("an image was read")

    still = GpsFixes(walk.gps.time_s, np.tile(walk.start, (N, 1)) + 1e-3 * np.arange(N)[:, None])
    assert walk.frames is not None
    with pytest.raises(InputError, match=r"spread over 0\.1 m"):
        localize(replace(walk, gps=still, frames=Frames(walk.frames.time_s, Unread())))  # type: ignore[arg-type]


def test_a_camera_far_ahead_of_the_body_gives_height_and_path_of_the_body_without_wheels(
    camera: Camera,
) -> None:
    """Weaving over level ground with exact fixes of the body; the camera is 2.4 m ahead and 1.4 m above it."""
    mount = camera.T_body_camera.copy()
    mount[:3, 3] = 2.4, 0.8, 1.4
    ahead, n, step_m = replace(camera, T_body_camera=mount), 56, 0.5
    yaw = 0.5 * np.sin(np.arange(n) / 8.0)
    body = np.zeros((n, 3))
    body[1:, :2] = np.cumsum(step_m * np.column_stack([np.cos(yaw), np.sin(yaw)])[:-1], axis=0)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = Rotation.from_euler("z", yaw[:, None]).as_matrix(), body
    world, times, places = PlaneWorld(ahead), 0.25 * np.arange(n), body + [500000.0, 6470000.0, 50.0]
    frames = Frames(times, tuple(world.image(pose) for pose in poses))
    fixes = GpsFixes(times, places)
    drive = Recording(UTM, places[0], fixes, camera=ahead, frames=frames, start_is_surveyed=False)
    config = LocalizationConfig(gps_bias_sigma_m=0.01, gps_white_sigma_m=0.01, landmark_min_range_m=0.5)
    found = localize(drive, config)
    ground = found.points.xyz
    assert np.hypot(*(found.trajectory.position - places)[:, :2].T).max() < 0.1
    assert len(ground) > 100
    assert abs(float(np.median(ground[:, 2])) - 50.0) < 0.15


def _arc(late_s: float = 0.0, start_off_m: float = 0.0) -> tuple[Recording, FloatArray]:
    """150 m on an arc of 40 m radius with recorded odometry and fixes of 0.3 m."""
    times = np.arange(0.0, 150.0)

    def place(at_s: FloatArray) -> FloatArray:
        angle = np.maximum(at_s, 0.0) / 40.0
        return 40.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), np.zeros_like(angle)])

    attitude = np.column_stack([np.zeros_like(times), np.zeros_like(times), times / 40.0])
    path = place(times)
    steps = np.einsum("nji,nj->ni", rotations(attitude[:-1]), np.diff(path, axis=0))
    fixes = place(times - late_s) + np.random.default_rng(5).normal(0.0, 0.3, path.shape)
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    return Recording(
        UTM, path[0] + [start_off_m, 0.0, 0.0], GpsFixes(times, fixes), odometry=Odometry(times, steps, attitude), sightings=sightings
    ), path  # fmt: skip


@pytest.mark.parametrize("fault", ["none", "late", "start", "repeated", "jump"])
def test_recorded_odometry_passes_the_same_checks_as_images(fault: str) -> None:
    recording, path = _arc(late_s=3.0 * (fault == "late"), start_off_m=30.0 * (fault == "start"))
    fixes = recording.gps.position.copy()
    if fault == "repeated":
        fixes[60:65] = fixes[60]
    if fault == "jump":
        fixes[60:65] += [40.0, 0.0, 0.0]
    result = localize(replace(recording, gps=replace(recording.gps, position=fixes)))
    # Fixes of 0.3 m over 150 s, with the receiver's assumed bias of 1 m: under a metre in all cases.
    assert np.hypot(*(result.trajectory.position - path)[:, :2].T).max() < 1.0
    expected = {"late": "late", "start": "surveyed", "repeated": "repeat", "jump": ""}.get(fault)
    # White fixes have no bias that varies within minutes, which the evidence shows.
    notes = [note for note in result.notes if "last longer" not in note]
    assert any(expected in note for note in notes) if expected else not notes
    assert result.n_fixes_refused == (5 if fault == "jump" else 0)


def test_a_start_that_was_not_surveyed_is_unknown_without_any_setting() -> None:
    recording, _ = _arc()
    off = replace(recording, start=recording.start + [8.0, 0.0, 0.0], start_is_surveyed=False)
    sigma_m = np.sqrt(localize(off).trajectory.covariance[0, 0, 0])
    asked = localize(recording, LocalizationConfig(start="unknown"))
    assert sigma_m == pytest.approx(np.sqrt(asked.trajectory.covariance[0, 0, 0]), rel=0.05)


def test_aligning_the_heading_keeps_the_shape(walk: Recording, visual: VisualOdometry) -> None:
    aligned, _ = align_heading(walk, visual)
    before, after = (dead_reckoning(o, np.zeros(3)) for o in (visual.odometry, aligned.odometry))
    np.testing.assert_allclose(np.linalg.norm(after, axis=1), np.linalg.norm(before, axis=1), atol=1e-9)


@pytest.mark.long
def test_api_and_command_give_the_same_bytes_on_real_images_without_wheels(
    real_data: Path, tmp_path: Path
) -> None:
    folder = real_data / "seq_kitti_mini" / "KITTI_sequence_1"
    if not folder.is_dir():
        pytest.skip(f"the images {folder} are not here; set FIRNLINE_DATA")
    sequence = read_sequence(folder)
    assert sequence.reference is not None
    real = sequence.reference[:, :3, 3] - sequence.reference[0, :3, 3] + [5e5, 6e6, 100.0]
    fixes = real + np.random.default_rng(0).normal(0.0, 0.3, real.shape)
    rows = np.column_stack([sequence.frames.time_s, fixes])
    header = "time_s,easting_m,northing_m,height_m"
    np.savetxt(tmp_path / "gps.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    recording = open_recording(folder, gps=tmp_path / "gps.csv", crs="EPSG:32632").records
    assert isinstance(recording, Recording)
    trajectory = localize(recording).trajectory
    off = trajectory.position - real
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.3
    trajectory.write(tmp_path / "trajectory.csv")
    words = ["localize", str(folder), "--gps", str(tmp_path / "gps.csv"), "--crs", "EPSG:32632"]
    result = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out"), "-q"])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "trajectory.csv").read_bytes() == (tmp_path / "trajectory.csv").read_bytes()


def test_a_path_that_its_last_fixes_contradict_is_lost_from_there_on() -> None:
    recording, path = _arc()
    fixes = recording.gps.position.copy()
    fixes[120:] += [40.0, 0.0, 0.0]
    result = localize(replace(recording, gps=replace(recording.gps, position=fixes)))
    assert result.n_fixes_refused == 30
    np.testing.assert_array_equal(np.flatnonzero(result.trajectory.health < 0.5), np.arange(120, 150))
    assert np.hypot(*(result.trajectory.position - path)[:, :2].T).max() < 2.0
    assert (localize(recording).trajectory.health == 1.0).all()


def test_the_clock_of_fixes_is_an_unknown_unless_they_are_of_survey_grade(
    walk: Recording, visual: VisualOdometry
) -> None:
    assert measure_motion(walk, LocalizationConfig(), visual).config.clock_sigma_s == 0.5
    precise = replace(walk, gps=replace(walk.gps, sigma_m=np.full(N, 0.02)))
    assert measure_motion(precise, LocalizationConfig(), visual).config.clock_sigma_s == 0.0
    stated = LocalizationConfig(clock_sigma_s=0.1)
    assert measure_motion(walk, stated, visual).config.clock_sigma_s == 0.1
