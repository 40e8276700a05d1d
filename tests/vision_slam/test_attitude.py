"""Roll and pitch by gravity, over a drive and over one in two pieces."""

import numpy as np
from scipy.spatial.transform import Rotation

from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.sensors.records import Inertial
from vision_slam.attitude import world_attitudes
from vision_slam.readers.sequence import ImageSequence


def test_what_came_after_a_hole_does_not_tilt_what_came_before(camera: Camera) -> None:
    """A level rover is carried for 20 s; images tie nothing over that, and put what follows on its side."""
    readings = np.r_[np.arange(0.0, 10.0, 0.1), np.arange(30.0, 60.0, 0.1)]
    times = np.r_[np.arange(0.0, 10.0, 0.25), np.arange(30.0, 60.0, 0.25)]
    level = np.tile([0.0, 0.0, 9.81], (len(readings), 1))
    blank = np.zeros((camera.height, camera.width), np.uint8)
    inertial = Inertial(readings, np.zeros((len(readings), 3)), level)
    recording = ImageSequence(camera, Frames(times, [blank] * len(times)), inertial=inertial)
    seen = np.where(
        (times < 20.0)[:, None, None], np.eye(3), Rotation.from_euler("x", 80.0, degrees=True).as_matrix()
    )
    attitude = world_attitudes(seen, times, recording)
    assert np.abs(attitude[:, :2]).max() < 1e-9
