"""Recorded drives with reference poses, and the faults that are put into their images."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.core.streams import stream
from survey.data.frames import Frames, Image
from survey.data.sensors.records import Wheels
from vision_slam.readers.sequence import ImageSequence
from vision_slam.recordings import read_sequence

DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[3] / "shared" / "data"))
_GAP_S = 1.0
_DROPPED_SHARE = 0.1
_K1 = -0.3


@dataclass(frozen=True)
class Images:
    """Images in memory."""

    pixels: list[Image]

    def __getitem__(self, index: int) -> Image:
        return self.pixels[index]


def drive_folders() -> dict[str, Path]:
    """Return the folders of the recorded drives by name."""
    return {
        place.name.removeprefix("seq_kitti_"): inner
        for place in sorted(DATA.glob("seq_*"))
        for inner in sorted(place.iterdir())
        if inner.is_dir()
    }


def opened(folder: Path) -> ImageSequence:
    """Read a drive with all its images."""
    sequence = read_sequence(folder)
    images = Images([sequence.frames[k] for k in range(len(sequence.frames))])
    return replace(sequence, frames=Frames(sequence.frames.time_s, images))


def with_gap(sequence: ImageSequence) -> ImageSequence:
    """Remove one second of images in the middle of the drive."""
    times = sequence.frames.time_s
    off_s = np.abs(times - 0.5 * (times[0] + times[-1]))
    return _selected(sequence, off_s >= 0.5 * _GAP_S)


def with_drops(sequence: ImageSequence) -> ImageSequence:
    """Remove a tenth of the images at random, not the first and the last."""
    stays = stream(1, "real drives", "drops").random(len(sequence.frames)) >= _DROPPED_SHARE
    stays[[0, -1]] = True
    return _selected(sequence, stays)


def with_swaps(sequence: ImageSequence) -> ImageSequence:
    """Swap two pairs of neighbouring images, at a third and at two thirds of the drive."""
    order = np.arange(len(sequence.frames))
    for k in (len(order) // 3, 2 * len(order) // 3):
        order[[k, k + 1]] = order[[k + 1, k]]
    images = Images([sequence.frames[int(k)] for k in order])
    return replace(sequence, frames=Frames(sequence.frames.time_s, images))


def with_focal_error(factor: float) -> Callable[[ImageSequence], ImageSequence]:
    """Return what multiplies the focal length of the calibration."""

    def changed(sequence: ImageSequence) -> ImageSequence:
        matrix = sequence.camera.matrix.copy()
        matrix[[0, 1], [0, 1]] *= factor
        return replace(sequence, camera=replace(sequence.camera, matrix=matrix))

    return changed


def with_undeclared_distortion(sequence: ImageSequence) -> ImageSequence:
    """Draw the images as a lens with k1 = −0.3 would, black where it shows nothing, and leave the calibration as it is."""
    camera = sequence.camera
    lens = replace(camera, distortion=np.array([_K1, 0.0, 0.0, 0.0, 0.0]))
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = lens.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64))
    source = camera.project(np.nan_to_num(rays))
    x, y = (
        np.nan_to_num(source[:, axis], nan=-1.0).reshape(columns.shape).astype(np.float32) for axis in (0, 1)
    )
    drawn = [
        np.asarray(cv2.remap(sequence.frames[k], x, y, cv2.INTER_LINEAR), np.uint8)
        for k in range(len(sequence.frames))
    ]
    return replace(sequence, frames=Frames(sequence.frames.time_s, Images(drawn)))


def with_wheels(factor: float) -> Callable[[ImageSequence], ImageSequence]:
    """Return what adds wheels that count the travel of the reference times a factor."""

    def equipped(sequence: ImageSequence) -> ImageSequence:
        travel = factor * travel_m(sequence)
        return replace(sequence, wheels=Wheels(reference_times(sequence), travel, travel))

    return equipped


def shifted_image(sequence: ImageSequence, shift_px: float, n: int) -> ImageSequence:
    """Return one image of a drive, shifted sideways by so much from frame to frame, as of a slow turn."""
    first = sequence.frames[0]
    size = (first.shape[1], first.shape[0])
    drawn = [
        np.asarray(
            cv2.warpAffine(
                first,
                np.array([[1.0, 0.0, shift_px * k], [0.0, 1.0, 0.0]]),
                size,
                flags=cv2.INTER_CUBIC,
                borderMode=cv2.BORDER_REFLECT,
            ),
            np.uint8,
        )
        for k in range(n)
    ]
    times = 0.05 * np.arange(float(n))
    return ImageSequence(sequence.camera, Frames(times, Images(drawn)))


def reference_times(sequence: ImageSequence) -> FloatArray:
    """Return the times of the reference poses [s]."""
    assert sequence.reference_time_s is not None
    return sequence.reference_time_s


def reference_places(sequence: ImageSequence) -> FloatArray:
    """Return the places of the reference poses (R, 3) [m], from the first on."""
    assert sequence.reference is not None
    places: FloatArray = sequence.reference[:, :3, 3] - sequence.reference[0, :3, 3]
    return places


def travel_m(sequence: ImageSequence) -> FloatArray:
    """Return the travel up to each reference pose (R,) [m]."""
    steps = np.linalg.norm(np.diff(reference_places(sequence), axis=0), axis=1)
    travel: FloatArray = np.r_[0.0, np.cumsum(steps)]
    return travel


def _selected(sequence: ImageSequence, stays: BoolArray) -> ImageSequence:
    index = np.flatnonzero(stays)
    images = Images([sequence.frames[int(k)] for k in index])
    return replace(sequence, frames=Frames(sequence.frames.time_s[index], images))
