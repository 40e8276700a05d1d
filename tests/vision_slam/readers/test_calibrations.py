"""Calibrations of cameras as other programs write them."""

from pathlib import Path

import numpy as np
import pytest

from survey import Camera
from survey.core.errors import InputError
from survey.data.camera import off_centre_note
from vision_slam.readers.calibrations import read_calibration

ROS = """\
image_width: 640
image_height: 480
camera_name: narrow
camera_matrix: {rows: 3, cols: 3, data: [400.5, 0, 321, 0, 401, 239, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.2, 0.1, 0.001, 0.002, 0]}
projection_matrix: {rows: 3, cols: 4, data: [390, 0, 320, 0, 0, 390, 240, 0, 0, 0, 1, 0]}
"""
MESSAGE = """\
height: 480
width: 640
distortion_model: "plumb_bob"
D: [-0.2, 0.1, 0.001, 0.002, 0.0]
K: [400.5, 0.0, 321.0, 0.0, 401.0, 239.0, 0.0, 0.0, 1.0]
"""
OPENCV = """\
%YAML:1.0
---
calibration_time: "Tue 4 Jun 2024"
image_Width: 640
image_Height: 480
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 400.5, 0., 321., 0., 401., 239., 0., 0., 1. ]
Distortion_Coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.2, 0.1, 0.001, 0.002, 0. ]
"""
KALIBR = """\
cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.2, 0.1, 0.001, 0.002]
  distortion_model: radtan
  intrinsics: [400.5, 401.0, 321.0, 239.0]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
"""
ORB_SLAM = """\
%YAML:1.0
Camera.type: "PinHole"
Camera.fx: 400.5
Camera.fy: 401.0
Camera.cx: 321.0
Camera.cy: 239.0
Camera.k1: -0.2
Camera.k2: 0.1
Camera.p1: 0.001
Camera.p2: 0.002
Camera.width: 640
Camera.height: 480
Camera.fps: 20.0
"""


@pytest.mark.parametrize(
    "text", [ROS, MESSAGE, OPENCV, KALIBR, ORB_SLAM], ids=["ros", "message", "opencv", "kalibr", "orb"]
)
def test_one_lens_in_the_words_of_other_programs(tmp_path: Path, text: str) -> None:
    (tmp_path / "camera.yaml").write_text(text)
    camera, notes = read_calibration(tmp_path / "camera.yaml")
    assert (camera.model, camera.width, camera.height) == ("pinhole", 640, 480)
    assert camera.matrix.tolist() == [[400.5, 0.0, 321.0], [0.0, 401.0, 239.0], [0.0, 0.0, 1.0]]
    assert camera.distortion.tolist() == [-0.2, 0.1, 0.001, 0.002, 0.0]
    assert not camera.distortion_is_assumed
    assert "taken to look straight ahead" in notes[0]


def test_an_equidistant_lens_is_a_fisheye(tmp_path: Path) -> None:
    (tmp_path / "camera.yml").write_text(KALIBR.replace("radtan", "equidistant"))
    camera, _ = read_calibration(tmp_path / "camera.yml")
    assert (camera.model, camera.distortion.tolist()) == ("fisheye", [-0.2, 0.1, 0.001, 0.002])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (KALIBR.replace("camera_model: pinhole", "camera_model: omni"), "camera model is 'omni'"),
        (KALIBR.replace("radtan", "fov"), "lens model is 'fov'"),
        (ROS.replace("0.002, 0]", "0.002, 0, 0.3, 0.1, 0.2]"), "8 coefficients of distortion"),
        (ROS.replace("image_width: 640\n", ""), "or no complete one .it lacks 'image_width'"),
        ("a: 1\n", "no calibration of ROS, OpenCV, Kalibr or ORB-SLAM"),
        ("a: [1\n", "no valid YAML .*line 2"),
        ("[" * 5000, "no valid YAML .*recursion"),
        ("3\n", "holds no keys"),
    ],
)
def test_other_calibrations_are_refused_by_what_is_wrong(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.raises(InputError, match=words):
        read_calibration(tmp_path / "camera.yaml")


@pytest.mark.parametrize(
    ("width", "height", "said"),
    [
        (320, 240, None),
        (640, 480, "0.5 times this size: multiply fx, fy, cx and cy by 2 where"),
        (170, 128, "1.9 times this size: multiply fx, fy, cx and cy by 0.53 where"),
        (640, 260, "a part cut out of larger images"),
    ],
)
def test_a_principal_point_far_from_the_middle_is_noted_with_the_scale(width, height, said):
    matrix = np.array([[150.0, 0.0, 159.5], [0.0, 150.0, 119.5], [0.0, 0.0, 1.0]])
    note = off_centre_note(Camera("pinhole", width, height, matrix, np.zeros(5), np.eye(4)))
    assert note is None if said is None else said in note


def test_a_calibration_of_twice_the_size_is_refused_with_the_scale():
    matrix = np.array([[300.0, 0.0, 320.0], [0.0, 300.0, 240.0], [0.0, 0.0, 1.0]])
    with pytest.raises(
        InputError, match=r"outside of the image of 320 × 240.* for images of 2 times this size"
    ):
        Camera("pinhole", 320, 240, matrix, np.zeros(5), np.eye(4))
