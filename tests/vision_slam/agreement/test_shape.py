"""Scale of wheels and tilt of the camera by the extent of the fixes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes, Wheels
from vision_slam.agreement.scale import refuse_other_wheel_scale, tilt_note
from vision_slam.agreement.steps import Drive, check_shape
from vision_slam.config import LocalizationConfig
from vision_slam.odometry.odometer import VisualOdometry

_TIMES = np.arange(40.0)
_CONFIG = LocalizationConfig()


def _path(*, bends: bool) -> FloatArray:
    """Return 40 m straight on, or 40 m with a turn by 90 degrees."""
    heading = np.radians(np.interp(_TIMES, [15.0, 25.0], [0.0, 90.0 if bends else 0.0]))
    return np.cumsum(np.column_stack([np.cos(heading), np.sin(heading), np.zeros(40)]), axis=0)


def _fixes(path: FloatArray, up_sigma_m: float = 0.5) -> GpsFixes:
    noise = np.random.default_rng(3).normal(0.0, [0.5, 0.5, up_sigma_m], (40, 3))
    turned = path @ Rotation.from_euler("z", 40.0, degrees=True).as_matrix().T
    return GpsFixes(_TIMES, turned + noise + [5e5, 6e6, 100.0])


def _tilted(path: FloatArray, axis: str, angle_deg: float) -> FloatArray:
    return 0.3 * path @ Rotation.from_euler(axis, angle_deg, degrees=True).as_matrix().T


@pytest.mark.parametrize("bends", [False, True])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_wheels_of_another_scale_are_refused(factor: float, *, bends: bool) -> None:
    path = _path(bends=bends)
    with pytest.raises(InputError, match=r"times as long as that of the fixes") as refused:
        refuse_other_wheel_scale(factor * path, _TIMES, _fixes(path), _CONFIG)
    assert float(str(refused.value).split(" is ")[1].split()[0]) == pytest.approx(factor, rel=0.05)


def test_worn_tracks_other_shapes_and_short_drives_are_not_refused() -> None:
    path = _path(bends=True)
    refuse_other_wheel_scale(1.3 * path, _TIMES, _fixes(path), _CONFIG)
    refuse_other_wheel_scale(0.5 * _path(bends=False), _TIMES, _fixes(path), _CONFIG)
    refuse_other_wheel_scale(0.2 * path, _TIMES, _fixes(0.1 * path), _CONFIG)
    refuse_other_wheel_scale(2.0 * path, _TIMES, _fixes(path).select(np.arange(3)), _CONFIG)


@pytest.mark.parametrize(
    ("axis", "angle_deg", "bends"),
    [("y", -90.0, True), ("y", 90.0, True), ("x", 180.0, True), ("x", 90.0, True), ("y", -80.0, False)],
)
def test_a_camera_far_from_its_mounting_is_refused(axis: str, angle_deg: float, *, bends: bool) -> None:
    path = _path(bends=bends)
    with pytest.raises(InputError, match="not mounted") as refused:
        tilt_note(_tilted(path, axis, angle_deg), _TIMES, _fixes(path), _CONFIG)
    assert _angle_deg(str(refused.value)) == pytest.approx(abs(angle_deg), abs=12.0)


def _angle_deg(note: str) -> float:
    return float(note.split("tilted by ")[1].split("°", maxsplit=1)[0])


def test_a_smaller_tilt_is_noted() -> None:
    path = 2.0 * _path(bends=False)
    note = tilt_note(_tilted(path, "y", -45.0), _TIMES, _fixes(path), _CONFIG)
    assert note is not None
    assert _angle_deg(note) == pytest.approx(45.0, abs=8.0)


@pytest.mark.parametrize("bends", [False, True])
def test_upright_cameras_and_bad_heights_are_not_noted(*, bends: bool) -> None:
    path = _path(bends=bends)
    assert tilt_note(0.3 * path, _TIMES, _fixes(path), _CONFIG) is None
    assert tilt_note(0.3 * path, _TIMES, _fixes(path, up_sigma_m=6.0), _CONFIG) is None
    assert tilt_note(_tilted(path, "y", 10.0), _TIMES, _fixes(path), _CONFIG) is None


def test_the_pipeline_checks_the_shape_of_drives_in_images() -> None:
    path = _path(bends=True)
    steps, level = np.diff(0.5 * path, axis=0), np.zeros((40, 3))
    odometry = Odometry(_TIMES, steps, level)
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    recording = OdometryRecording(
        "EPSG:32608", path[0], _fixes(path), odometry=odometry, sightings=sightings, start_is_surveyed=False
    )
    visual = VisualOdometry(odometry, sightings, (), np.zeros(40, dtype=np.bool_))
    drive = Drive(recording, _CONFIG, visual)
    assert check_shape(drive) is drive
    rolled = replace(recording, wheels=Wheels(_TIMES, 0.5 * _TIMES, 0.5 * _TIMES))
    with pytest.raises(InputError, match="times as long"):
        check_shape(replace(drive, recording=rolled))
    assert check_shape(Drive(rolled, _CONFIG)).notes == ()
