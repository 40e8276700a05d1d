"""Drives that all programs get: recorded streets, simulated snow at two frame rates, and a long drive over it with turns."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.real_drives.drives import drive_folders, opened
from benchmarks.visual_slam import rendered_drive
from survey.core.arrays import FloatArray
from survey.data.frames import Frames, Image
from survey.data.recording import Recording
from survey.data.trajectory import Trajectory
from vision_slam.readers.sequence import ImageSequence

_SHORT = ("planner.swaths=1", "area.bounds_m=[526040.0, 6478040.0, 526100.0, 6478060.0]")
_LONG = ("planner.swaths=6", "area.bounds_m=[526040.0, 6478040.0, 526100.0, 6478130.0]")
SNOW = ((61, 4, _SHORT), (62, 4, _SHORT), (61, 10, _SHORT), (63, 4, _LONG))
"""Seeds on which no setting was chosen, images a second, and the survey: 60 m along one swath, or 590 m along six."""
_RATE_HZ = 4  # of the mission


@dataclass(frozen=True)
class PeerDrive:
    """Images with reference poses; `is_snow`: simulated."""

    name: str
    sequence: ImageSequence
    is_snow: bool = False

    @cached_property
    def images(self) -> list[Image]:
        """All images, grey."""
        frames = self.sequence.frames
        images = (frames[k] for k in range(len(frames)))
        return [cv2.cvtColor(one, cv2.COLOR_BGR2GRAY) if one.ndim == 3 else one for one in images]

    @property
    def time_s(self) -> FloatArray:
        """Times of the images [s]."""
        return self.sequence.frames.time_s

    @property
    def reference(self) -> FloatArray:
        """Poses (N, 4, 4) of the camera at the images, in the frame of the reference."""
        assert self.sequence.reference is not None
        return self.sequence.reference @ self.sequence.camera.T_body_camera


def drives(*, quick: bool) -> Iterator[PeerDrive]:
    """Yield the drives; a quick run has the shortest one alone."""
    found = [PeerDrive(f"street {name}", opened(folder)) for name, folder in drive_folders().items()]
    found.sort(key=lambda drive: len(drive.time_s))
    yield from found[: 1 if quick else None]
    if not quick:
        yield from (_snow(*drive) for drive in SNOW)


def _snow(seed: int, rate_hz: int, survey: tuple[str, ...]) -> PeerDrive:
    """Read a simulated drive, rendered now if it has not been yet."""
    rate = () if rate_hz == _RATE_HZ else (f"instruments.frame_rate_hz={rate_hz}.0",)
    folder = rendered_drive(seed, (*survey, *rate))
    recording = Recording.read(folder / "recording")
    assert recording.frames is not None
    assert recording.camera is not None
    real = Trajectory.read(folder / "truth" / "trajectory.tum", recording.crs)
    time_s = recording.frames.time_s
    poses = np.tile(np.eye(4), (len(time_s), 1, 1))
    turns = Slerp(real.time_s, Rotation.from_quat(real.quaternion))
    poses[:, :3, :3] = turns(time_s.clip(*real.time_s[[0, -1]])).as_matrix()
    origin = real.position[0]
    poses[:, :3, 3] = np.column_stack(
        [np.interp(time_s, real.time_s, axis) for axis in (real.position - origin).T]
    )
    frames = Frames(time_s, recording.frames.images)
    sequence = ImageSequence(recording.camera, frames, reference_time_s=time_s, reference=poses)
    return PeerDrive(f"snow {seed}, {rate_hz} Hz", sequence, is_snow=True)
