"""Calibration from rendered images of boards, against the lens that they were rendered with."""

import shutil

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.core.errors import ConfigError, InputError
from survey.data.camera import Camera
from tests.printing import assert_printable
from tests.vision_slam.rendered import (
    CAMERA,
    charuco_images,
    chessboard_images,
    poses,
)
from vision_slam.calibration import (
    BoardView,
    Chessboard,
    calibrate,
    calibration_figure,
    fit_lens,
    parameter_covariance,
    tilts_deg,
)

TRUE = np.r_[CAMERA.matrix[0, 0], CAMERA.matrix[1, 1], CAMERA.matrix[:2, 2], CAMERA.distortion]
BOARD = Chessboard(9, 6, 0.02)


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board")
    chessboard_images(folder, n=12, seed=3)
    cv2.imwrite(str(folder / "IMG_9999.png"), np.full((360, 480), 90, np.uint8))  # no board in it
    return folder


@pytest.fixture(scope="module")
def calibration(images):
    return calibrate(images, BOARD)


def test_the_lens_is_found_within_three_standard_deviations(calibration):
    assert np.abs((calibration.values - TRUE) / calibration.sigma).max() < 3.0
    assert calibration.sigma[:4].max() < 4.0
    assert calibration.fit.rms_px < 0.2


def test_images_without_the_board_are_named(calibration):
    assert calibration.rejected == {"IMG_9999.png": "board not found"}
    assert len(calibration.accepted) == 12
    assert 0.5 < calibration.coverage <= 1.0


def test_the_calibration_reads_back_with_its_standard_deviations(calibration, tmp_path):
    calibration.write(tmp_path / "camera.toml")
    camera = Camera.read(tmp_path / "camera.toml")
    np.testing.assert_allclose(camera.matrix, calibration.camera.matrix)
    np.testing.assert_allclose(camera.distortion, calibration.camera.distortion)
    assert not camera.distortion_is_assumed
    assert "[calibration.sigma]\nfx = " in (tmp_path / "camera.toml").read_text()


def test_the_picture_shows_every_residual(calibration):
    figure = calibration_figure(calibration)
    arrows = figure.axes[0].collections[0]
    assert arrows.N == 12 * 54
    assert len(figure.axes[2].patches) == 12


def test_the_picture_can_be_printed(calibration):
    assert_printable(calibration_figure(calibration))


def test_a_blurred_view_is_left_out_by_name(images, tmp_path):
    shutil.copytree(images, tmp_path / "board")
    file = tmp_path / "board" / "IMG_0004.png"
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    # Rows shifted against one another, as a rolling shutter in motion shifts them.
    shifts = np.round(3.0 * np.sin(np.arange(len(image)) / 25.0)).astype(int)
    sheared = np.stack([np.roll(row, shift) for row, shift in zip(image, shifts, strict=True)])
    cv2.imwrite(str(file), sheared)
    found = calibrate(tmp_path / "board", BOARD)
    assert "IMG_0004.png" in found.rejected
    assert np.abs((found.values - TRUE) / found.sigma).max() < 4.0


def test_a_charuco_board_is_found_and_its_lens(tmp_path):
    found = calibrate(tmp_path, charuco_images(tmp_path))
    assert np.abs((found.values - TRUE) / found.sigma).max() < 3.5
    assert abs(found.values[0] / TRUE[0] - 1.0) < 0.015


def test_too_few_views_are_refused_with_what_is_missing(images, tmp_path):
    for k in (0, 1, 2):
        shutil.copy(images / f"IMG_000{k}.png", tmp_path)
    with pytest.raises(InputError, match="in 3 of 3 images; at least 8 views were expected"):
        calibrate(tmp_path, BOARD)
    shutil.copy(images / "IMG_9999.png", tmp_path)
    with pytest.raises(InputError, match=r"in 3 of 4 images \(IMG_9999\.png: board not found\)"):
        calibrate(tmp_path, BOARD)


def test_views_of_one_side_are_refused_with_the_side(tmp_path):
    chessboard_images(tmp_path, n=8, seed=2, spread=0.0, depth=(0.7, 0.8))
    with pytest.raises(
        InputError, match=r"has reached \d+ % of the image area, and least in the (upper|lower)"
    ):
        calibrate(tmp_path, BOARD)


def test_views_without_tilt_are_refused(tmp_path):
    chessboard_images(tmp_path, n=8, seed=2, tilt_deg=3.0)
    with pytest.raises(InputError, match="tilt the board by 20 to 45°"):
        calibrate(tmp_path, BOARD)


def test_the_tilt_of_a_board_is_measured_about_both_axes():
    turned = np.array([[0.0, np.radians(20.0), 0.0, 0.0, 0.0, 1.0]])
    assert tilts_deg(turned)[0] == pytest.approx([20.0, 0.0])


@pytest.mark.parametrize(
    ("options", "words", "code"),
    [
        ([], "one board was expected", 4),
        (["--board", "9x6", "--charuco", "8x5"], "one board was expected", 4),
        (["--board", "nine"], "two numbers such as 9x6", 4),
        (["--board", "9x6", "--marker-mm", "9"], "a chessboard has no markers", 4),
        (["--charuco", "8x5"], "name their side with --marker-mm", 4),
        (["--charuco", "8x5", "--marker-mm", "30"], "smaller markers were expected", 4),
        (["--charuco", "8x5", "--marker-mm", "9", "--dictionary", "X"], "no dictionary of markers 'X'", 4),
        (["--board", "9x6"], "holds no images", 3),
    ],
)
def test_options_that_fit_no_board_are_refused_in_one_sentence(tmp_path, options, words, code):
    (tmp_path / "empty").mkdir()
    out = ["-o", str(tmp_path / "camera.toml")]
    done = CliRunner().invoke(app, ["calibrate", str(tmp_path / "empty"), *options, *out])
    assert done.exit_code == code
    assert words in " ".join(done.output.split())
    assert not (tmp_path / "camera.toml").exists()


def test_the_command_writes_a_calibration_and_a_picture(images, tmp_path):
    out = tmp_path / "camera.toml"
    done = CliRunner().invoke(app, ["calibrate", str(images), "--board", "9x6", "-o", str(out), "-q"])
    assert done.exit_code == 0, done.output
    assert "  left out           IMG_9999.png: board not found" in done.output
    assert f"  next               firnline localize IMAGES --camera {out}" in done.output
    assert (tmp_path / "camera.png").read_bytes().startswith(b"\x89PNG")
    assert Camera.read(out).width == 480
    again = CliRunner().invoke(app, ["calibrate", str(images), "--board", "9x6", "-o", str(out), "-q"])
    assert again.exit_code == 3


def test_a_board_of_no_size_is_refused():
    with pytest.raises(ConfigError, match="at least 3 × 3 corners"):
        Chessboard(2, 6)


def test_a_fisheye_lens_is_found_from_its_corners():
    lens = np.array([0.05, -0.01, 0.003, -0.001])
    matrix = np.array([[260.0, 0.0, 322.0], [0.0, 261.0, 238.0], [0.0, 0.0, 1.0]])
    camera, rng = Camera("fisheye", 640, 480, matrix, lens, np.eye(4)), np.random.default_rng(1)
    places = np.mgrid[:9, :6].T.reshape(-1, 2) * 0.02
    views = []
    for pose in poses(16, (0.16, 0.1), rng, spread=0.6, depth=(0.12, 0.2)):
        xyz = Rotation.from_rotvec(pose[:3]).apply(np.c_[places, np.zeros(54)]) + pose[3:]
        views.append(BoardView(places, camera.project(xyz) + 0.1 * rng.standard_normal((54, 2))))
    fit = fit_lens(views, (640, 480), "fisheye")
    sigma = np.sqrt(np.diagonal(parameter_covariance(fit, views)))
    assert fit.rms_px == pytest.approx(0.141, abs=0.01)
    assert np.abs((fit.parameters - np.r_[260.0, 261.0, 322.0, 238.0, lens]) / sigma).max() < 3.0
