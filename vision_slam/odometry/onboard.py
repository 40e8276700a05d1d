"""Incremental visual odometry of records that arrive during the drive."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from survey import Camera
from survey.core import FloatArray
from survey.data.frames import Frames, Image
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import Compass, Inertial, SensorRecords, Wheels
from survey.io.tables import read_table, write_table
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.odometer import VisualOdometer, VisualOdometry
from vision_slam.odometry.visual_slam import FramePose

Records = TypeVar("Records", bound=SensorRecords)

_SET_OFF_M = 2e-3  # the wheels turn; until then they rest, and what the gyro says is bias
_LEVELLED_S = 1.0
_KEPT_S = 1.0
_MOST_WAITING = 40


@dataclass(frozen=True)
class _Records:
    """Records of a drive so far, or the latest of them."""

    camera: Camera
    wheels: Wheels | None
    inertial: Inertial | None
    compass: Compass | None = None
    frames: Frames | None = None


class OnboardOdometry:
    """Incremental visual odometry of readings and images in the order of their arrival.

    An image is processed as soon as wheels and gyro reach its time. Images before the first
    motion wait until the wheels turn, because the gyro bias is estimated while standing. Memory
    holds the window of keyframes, the finished tracks and the inertial records (20 MB per hour),
    which level the path at the end. The result has the same bytes as `visual_odometry`.

    `camera`: calibration and mounting. `config`: settings of visual odometry.

    Without wheels or without a gyro the delay is forty images.
    """

    def __init__(self, camera: Camera, config: VisualOdometryConfig | None = None) -> None:
        self._camera, self._config = camera, config
        self._wheels, self._compass = list[Wheels](), list[Compass]()
        self._inertial = list[Inertial]()
        self._waiting: deque[tuple[float, Image]] = deque()
        self._odometer: VisualOdometer | None = None
        self._at_s, self._n_reported = 0.0, 0

    def sense(self, wheels: Wheels | None, inertial: Inertial | None, compass: Compass | None) -> None:
        """Add the readings since the last call."""
        self._wheels += [] if wheels is None else [wheels]
        self._inertial += [] if inertial is None else [inertial]
        self._compass += [] if compass is None else [compass]

    def look(self, image: Image, time_s: float) -> None:
        """Add the next image.

        `image` (H, W) or (H, W, 3): grey, or blue, green, red. `time_s`: its time [s].
        """
        self._waiting.append((time_s, image))

    def poses(self) -> list[tuple[FramePose, FloatArray]]:
        """Return the frames that could be placed since the last call, with the body's pose (4, 4) at each.

        Poses are relative to the first image, levelled there.
        """
        while self._waiting and self._is_ready():
            self._look_at_next()
        if self._odometer is None:
            return []
        slam = self._odometer.slam
        fresh = slam.frames[self._n_reported :]
        self._n_reported = len(slam.frames)
        return [(frame, slam.pose(frame)) for frame in fresh]

    def finished(self) -> VisualOdometry | None:
        """Process the waiting images and return the visual odometry; None for fewer than two images."""
        while self._waiting:
            self._look_at_next()
        if self._odometer is None or len(self._odometer.slam.frames) < 2:
            return None
        records = _Records(self._camera, joined(self._wheels), joined(self._inertial), joined(self._compass))
        return self._odometer.finish(records)

    def _is_ready(self) -> bool:
        """Return whether the next image can be processed: wheels and gyro reach its time, and the drive has begun."""
        if len(self._waiting) > _MOST_WAITING:
            return True
        if not self._wheels or not self._inertial:
            return False
        reached_s = min(float(self._wheels[-1].time_s[-1]), float(self._inertial[-1].time_s[-1]))
        if self._odometer is not None:
            return reached_s >= self._waiting[0][0]
        first, last = self._wheels[0], self._wheels[-1]
        rolled = abs(last.left_m[-1] - first.left_m[0]) + abs(last.right_m[-1] - first.right_m[0])
        return bool(rolled > _SET_OFF_M) and reached_s > self._waiting[0][0] + _LEVELLED_S

    def _look_at_next(self) -> None:
        time_s, image = self._waiting.popleft()
        recent = _Records(self._camera, self._latest(self._wheels), self._latest(self._inertial))
        if self._odometer is None:
            self._odometer = VisualOdometer(self._camera, recent, self._config, time_s)
        else:
            self._odometer.sensors.continue_with(recent)
        self._odometer.add_image(image, time_s)
        self._at_s = time_s

    def _latest(self, parts: list[Records]) -> Records | None:
        """Return the readings from a little before the last image on."""
        n = 1
        while n < len(parts) and parts[-n].time_s[0] > self._at_s - _KEPT_S:
            n += 1
        return joined(parts[-n:])


def joined(parts: Sequence[Records]) -> Records | None:
    """Concatenate readings of one sensor."""
    if not parts:
        return None
    names = [field.name for field in fields(parts[0])]
    return type(parts[0])(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def write_visual_odometry(found: VisualOdometry, folder: Path) -> None:
    """Write ``odometry.csv``, ``sightings.csv`` and ``health.csv`` (one row per frame)."""
    folder.mkdir(parents=True, exist_ok=True)
    found.odometry.write(folder / "odometry.csv")
    found.sightings.write(folder / "sightings.csv")
    columns = {name: np.array([getattr(frame, name) for frame in found.health], float) for name in _HEALTH}
    write_table(folder / "health.csv", columns | {"is_lost": found.is_lost.astype(float)})


def read_visual_odometry(folder: Path) -> VisualOdometry:
    """Read the files of `write_visual_odometry`, to the last bit."""
    table = read_table(folder / "health.csv", [*_HEALTH, "is_lost"], what="the health of the frames")
    counts = {name: table[name].astype(int).tolist() for name in ("n_followed", "n_inliers")}
    rows = {name: table[name].tolist() for name in _HEALTH} | counts
    frames = [FrameHealth(*values) for values in zip(*(rows[name] for name in _HEALTH), strict=True)]
    return VisualOdometry(
        Odometry.read(folder / "odometry.csv"),
        Sightings.read(folder / "sightings.csv"),
        tuple(replace(frame, is_visual=bool(frame.is_visual)) for frame in frames),
        table["is_lost"] > 0.5,
    )


_HEALTH = tuple(field.name for field in fields(FrameHealth))
