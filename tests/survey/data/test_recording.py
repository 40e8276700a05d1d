"""A recording is read back as it was written, and a damaged one is named."""

import numpy as np
import pytest

from survey import Camera, Frames, InputError, Recording
from survey.data.frames import FrameWriter
from survey.data.sensors.records import GpsFixes, Inertial, Wheels
from survey.data.sensors.stakes import Stakes, StakeSightings

MOUNTED = np.array([[0.0, 0, 1, 0.3], [-1, 0, 0, 0], [0, -1, 0, 0.7], [0, 0, 0, 1]])
FISHEYE = Camera(
    "fisheye", 64, 48, [[30.0, 0, 31.5], [0, 30.0, 23.5], [0, 0, 1]], [0.02, -0.01, 0.003, 0], MOUNTED
)


def recording() -> Recording:
    rng = np.random.default_rng(3)
    time_s = np.arange(4.0)
    return Recording(
        "EPSG:32608",
        [526000.0, 6478000.0, 100.0],
        GpsFixes(time_s, rng.normal(size=(4, 3))),
        wheels=Wheels(time_s, time_s, 1.1 * time_s),
        inertial=Inertial(time_s, rng.normal(size=(4, 3)), rng.normal(size=(4, 3))),
        stakes=Stakes(rng.normal(size=(2, 3)), [0.05, 0.02]),
        stake_sightings=StakeSightings(
            [1.0, 1.0], [0, 1], rng.normal(size=(2, 3)), np.tile(np.eye(3), (2, 1, 1))
        ),
        camera=FISHEYE,
        frames=Frames([0.0, 0.25], rng.integers(0, 256, (2, 48, 64), dtype=np.uint8)),
    )


def test_everything_sensed_is_read_back(tmp_path):
    written = recording()
    written.write(tmp_path / "recording")
    read = Recording.read(tmp_path / "recording")
    assert (read.inertial.gyro_rad_s == written.inertial.gyro_rad_s).all()
    assert (read.stake_sightings.covariance == written.stake_sightings.covariance).all()
    assert (read.stakes.position == written.stakes.position).all()
    assert (read.wheels.right_m == written.wheels.right_m).all()
    assert read.camera.matrix.tolist() == FISHEYE.matrix.tolist()
    assert all((read.frames[k] == written.frames[k]).all() for k in range(2))
    assert read.odometry is None


def test_projection_undoes_rays_through_the_fisheye():
    uv = np.array([[3.0, 5.0], [31.5, 23.5], [60.0, 40.0]])
    assert FISHEYE.project(3.0 * FISHEYE.rays(uv)) == pytest.approx(uv, abs=1e-6)
    assert np.isnan(FISHEYE.project(np.array([[0.0, 0.0, -1.0]]))).all()


def test_half_as_many_pixels_see_the_same():
    uv = np.array([[10.0, 12.0]])  # the centre of pixel (10, 12) lies at 4.75, 5.75 of the halved image
    assert FISHEYE.scaled(0.5).rays(np.array([[4.75, 5.75]])) == pytest.approx(FISHEYE.rays(uv), abs=1e-9)


def test_frames_written_during_the_drive_stay(tmp_path):
    with FrameWriter(tmp_path / "frames") as writer:
        writer.add(0.0, np.full((48, 64), 7, np.uint8))
    Recording(
        "EPSG:32608",
        np.zeros(3),
        recording().gps,
        camera=FISHEYE,
        frames=Frames.read(tmp_path / "frames"),
    ).write(tmp_path)
    assert Recording.read(tmp_path).frames[0].max() == 7


def test_a_frame_that_cannot_be_written_is_refused_at_the_latest_in_the_end(tmp_path):
    def write_where_the_folder_is_gone() -> None:
        with FrameWriter(tmp_path / "frames") as writer:
            (tmp_path / "frames").rmdir()
            writer.add(0.0, np.zeros((4, 6), np.uint8))

    with pytest.raises(FileNotFoundError):
        write_where_the_folder_is_gone()
    assert not (tmp_path / "frames").exists()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda place: (place / "frames" / "000001.png").unlink(), "000001.png, which is not there"),
        (lambda place: (place / "frames" / "frames.csv").unlink(), "list of frames"),
        (lambda place: (place / "camera.toml").write_text("model = 'pinhole'"), "camera.toml"),
        (lambda place: (place / "wheels.csv").write_text("time_s,left_m\n0,1\n"), "right_m"),
        (lambda place: (place / "camera.toml").unlink(), "lacks camera"),
    ],
)
def test_damage_is_named(tmp_path, damage, words):
    recording().write(tmp_path / "recording")
    damage(tmp_path / "recording")
    with pytest.raises(ValueError, match=words):
        Recording.read(tmp_path / "recording")


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.9, 0.995])
def test_a_truncated_image_is_named(tmp_path, kept):
    recording().write(tmp_path / "recording")
    file = tmp_path / "recording" / "frames" / "000000.png"
    file.write_bytes(file.read_bytes()[: int(kept * file.stat().st_size)])
    with pytest.raises(InputError, match=r"000000\.png cannot be decoded"):
        Recording.read(tmp_path / "recording").frames[0]


def test_a_camera_whose_pose_is_no_rotation_is_refused():
    with pytest.raises(InputError, match="no rotation"):
        Camera("pinhole", 4, 4, np.eye(3), np.zeros(5), 2 * np.eye(4))
