"""Corner detection with an absolute threshold and an even spread over the image."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from survey.data.camera.frames import Image
from vision_slam.odometry.config import VisualOdometryConfig

Pixels = npt.NDArray[np.float32]

_GRID = (8, 6)
_BORDER_PX = 6


def detect(image: Image, taken: Pixels, n_wanted: int, config: VisualOdometryConfig) -> Pixels:
    """Find up to `n_wanted` new corners (K, 2), spread over the image and away from those `taken` (M, 2).

    Responses are compared with an absolute threshold, and each cell of a grid takes its
    share: the usual threshold relative to the best corner would leave snow without any
    corner whenever a mountain stands on the horizon.
    """
    response = _response(image, config)
    _blank(response, taken, config.corner_spacing_px)
    side = config.corner_spacing_px + 1
    is_peak = (response >= cv2.dilate(response, np.ones((side, side), np.uint8))) & (
        response > config.corner_threshold
    )
    rows, columns = np.nonzero(is_peak)
    peaks = np.column_stack([columns, rows]).astype(np.float32)[
        np.argsort(-response[rows, columns], kind="stable")
    ]
    pixels = _spread(peaks, taken, (image.shape[1], image.shape[0]), config.n_features)[:n_wanted]
    if len(pixels):
        ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 10, 0.03)
        cv2.cornerSubPix(image, pixels.reshape(-1, 1, 2), (3, 3), (-1, -1), ends)
    return pixels


def _response(image: Image, config: VisualOdometryConfig) -> Any:
    """Return the strength of the corner at each pixel; keypoint detectors fill in the places that they name."""
    if config.detector == "gftt":
        return cv2.cornerMinEigenVal(image, 5)
    if config.detector == "harris":
        return np.sqrt(np.maximum(cv2.cornerHarris(image, 5, 3, 0.04), 0.0))
    finder: Any = (
        cv2.ORB.create(4 * config.n_features)
        if config.detector == "orb"
        else cv2.SIFT.create(4 * config.n_features)
    )
    response = np.zeros(image.shape, np.float32)
    for key in finder.detect(image, None):
        column, row = (round(value) for value in key.pt)
        response[row, column] = max(config.corner_threshold * (1.0 + key.response), response[row, column])
    return response


def _blank(response: Any, taken: Pixels, radius_px: int) -> None:
    for column, row in taken.tolist():
        cv2.circle(response, (int(column), int(row)), radius_px, 0.0, -1)
    response[:_BORDER_PX] = response[-_BORDER_PX:] = 0.0
    response[:, :_BORDER_PX] = response[:, -_BORDER_PX:] = 0.0


def _spread(peaks: Pixels, taken: Pixels, size: tuple[int, int], n_all: int) -> Pixels:
    """Keep of peaks (K, 2), strongest first, no more in any cell of the grid than its share."""
    cells = np.array(_GRID) / np.array(size)
    count = np.zeros(_GRID, dtype=int)
    np.add.at(count, tuple((taken * cells).astype(int).T), 1)
    share = int(np.ceil(1.25 * n_all / count.size))
    is_used = np.zeros(len(peaks), dtype=bool)
    for index, (across, down) in enumerate((peaks * cells).astype(int).tolist()):
        if count[across, down] < share:
            count[across, down] += 1
            is_used[index] = True
    return peaks[is_used]
