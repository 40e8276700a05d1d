"""Previews of a drive: video, contact sheet, animation."""

from io import BytesIO

import cv2
import numpy as np
from PIL import Image as Picture

from sim.simulate.simulated_drive import animated, write_contact_sheet, write_preview
from survey.data.frames import Frames


def frames(n: int = 8) -> Frames:
    images = [np.full((60, 80), 20 * k, np.uint8) for k in range(n)]
    return Frames(0.25 * np.arange(n), images)


def test_a_video_has_every_frame(tmp_path):
    write_preview(frames(), tmp_path / "preview.mp4")
    video = cv2.VideoCapture(str(tmp_path / "preview.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 8
    assert video.get(cv2.CAP_PROP_FPS) == 16.0  # four times as fast as 4 a second


def test_a_contact_sheet_has_rows_and_columns(tmp_path):
    write_contact_sheet(frames(), tmp_path / "sheet.png", n_columns=3, n_rows=2)
    with Picture.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (3 * 80, 2 * 60)


def test_an_animation_shows_frames_at_equal_steps():
    with Picture.open(BytesIO(animated(frames(), n_shown=4))) as animation:
        assert animation.n_frames == 4
