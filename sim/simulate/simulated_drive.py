"""Simulated drive in the vision fidelity: recording, truth, ending, and their files.

`SimulatedDrive` is the result and writes its files. `DriveMonitor` finds the `Ending`: arrival, or what has stopped the
rover. The preview is a video (MPEG-4), an animated WebP, and a contact sheet.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Picture

from sim.config.mission import MissionConfig
from sim.vehicle.motion import RoverState
from sim.vehicle.pursuit import PurePursuit
from sim.world.fine_terrain import FineTerrain
from sim.world.hazards import Hazard
from survey import InputError, Recording, Truth
from survey.core import FloatArray, replacing, write_json
from survey.data.frames import Frames, Image
from survey.interchange.layouts import write_tum_list
from survey.io.tables import write_table
from survey.io.vector import write_features
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.onboard import write_visual_odometry

DRIVE_FILE = "drive.json"
"""How a drive ended, with its length, time and energy."""
ONBOARD = "onboard"
"""Folder within the recording that holds the visual odometry of the onboard computer."""
_ESTIMATE_COLUMNS = ("time_s", "easting_m", "northing_m", "heading_rad")


class Ending(Enum):
    """How a drive ended."""

    ARRIVED = "arrived"
    STALLED = "stalled"
    TIPPED_OVER = "tipped over"
    FELL = "fell"
    BATTERY_EMPTY = "battery empty"
    LEFT_THE_MAP = "left the map"
    OUT_OF_TIME = "out of time"
    BY_OPERATOR = "ended by the operator"


@dataclass(frozen=True)
class SimulatedDrive:
    """Result of a drive.

    `recording`: sensor records; frames are in the drive's folder. `truth`: terrain and real path, 20 poses a
    second. `ending`: how it ended. `progress_m`: progress along the route [m]. `energy_j`: energy drawn from
    the battery [J]. `route_m`: length of the route [m]. `hazards`: crevasses, channels, pools and cones of
    the ground. `visual_odometry`: result of the onboard computer. `estimates` (N, 4): poses that were steered
    by, at every frame: time [s], easting and northing [m], heading [rad].
    """

    recording: Recording
    truth: Truth
    ending: Ending
    progress_m: float
    energy_j: float
    route_m: float
    hazards: tuple[Hazard, ...]
    visual_odometry: VisualOdometry | None = None
    estimates: FloatArray | None = None

    def write(self, folder: Path) -> None:
        """Write recording, truth, ``drive.json``, steered estimates, hazards, a video and a contact sheet."""
        self.recording.write(folder / "recording")
        if self.visual_odometry is not None:
            write_visual_odometry(self.visual_odometry, folder / "recording" / ONBOARD)
        self.truth.write(folder / "truth")
        write_json(folder / DRIVE_FILE, self._summary())
        if self.estimates is not None:
            columns = dict(zip(_ESTIMATE_COLUMNS, self.estimates.T, strict=True))
            write_table(folder / "estimated.csv", columns)
        self._write_hazards(folder / "hazards.geojson")
        if self.recording.frames is not None:
            write_tum_list(self.recording.frames, folder / "recording")
            write_preview(self.recording.frames, folder / "preview.mp4")
            write_contact_sheet(self.recording.frames, folder / "contact_sheet.png")

    def _summary(self) -> dict[str, float | str]:
        return {
            "ending": self.ending.value,
            "progress_m": round(self.progress_m, 2),
            "route_m": round(self.route_m, 2),
            "duration_s": float(self.truth.trajectory.time_s[-1]),
            "energy_j": round(self.energy_j, 1),
        }

    def _write_hazards(self, path: Path) -> None:
        if self.hazards:
            kinds = np.array([hazard.kind for hazard in self.hazards], dtype=object)
            outlines = [hazard.outline for hazard in self.hazards]
            write_features(path, outlines, {"kind": kinds}, self.recording.crs, layer="hazards")


LOGGED_HZ = 80
"""States per second that instruments read from."""
STEERED_HZ = 20
"""Steering commands per second, and states per second of the truth."""
STANDING_S = 1.0
"""Time that the rover stands still at the start [s]."""

_TIPPED_COS = np.cos(np.radians(65.0))
_FELL_M = 0.8
_STALLED_S, _STALLED_M = 20.0, 0.5


class DriveMonitor:
    """Finds out whether and how a drive has ended.

    `ground`: the ground, with its bounds. `pursuit`: follower of the route. `mission`: speed and battery of
    the rover.
    """

    def __init__(self, ground: FineTerrain, pursuit: PurePursuit, mission: MissionConfig) -> None:
        self._bounds, self._pursuit = ground.bounds, pursuit
        self._battery_j = mission.rover.battery_j
        self._speed_m_s = mission.rover.speed_m_s

    def ending(self, states: Sequence[RoverState], steered_xy: FloatArray) -> Ending | None:
        """Return how the drive has ended, or None while it goes on.

        `states` are those at `STEERED_HZ` since the start, `steered_xy` (2,) the position that is steered by [m].
        """
        longest_s = 3.0 * self._pursuit.length_m / self._speed_m_s + 60.0
        reasons = {
            Ending.ARRIVED: self._pursuit.is_done(steered_xy),
            Ending.STALLED: _is_stalled(states),
            Ending.OUT_OF_TIME: states[-1].time_s > longest_s,
        }
        return self.accident(states) or _first_true(reasons)

    def accident(self, states: Sequence[RoverState]) -> Ending | None:
        """Return what has ended the drive of a rover that follows no route, or None while it goes on."""
        state = states[-1]
        xmin, ymin, xmax, ymax = self._bounds
        x, y, z = state.position
        a_second_ago = states[max(len(states) - 1 - STEERED_HZ, 0)]
        reasons = {
            Ending.LEFT_THE_MAP: not (xmin < x < xmax and ymin < y < ymax),
            Ending.TIPPED_OVER: _upright(state) < _TIPPED_COS,
            Ending.FELL: a_second_ago.position[2] - z > _FELL_M,
            Ending.BATTERY_EMPTY: self._battery_j is not None and state.energy_j > self._battery_j,
        }
        return _first_true(reasons)


def _first_true(reasons: dict[Ending, bool]) -> Ending | None:
    return next((ending for ending, is_so in reasons.items() if is_so), None)


def _is_stalled(states: Sequence[RoverState]) -> bool:
    """Return whether the rover is where it was some time ago."""
    n = round(_STALLED_S * STEERED_HZ)
    if len(states) <= n + STANDING_S * STEERED_HZ:
        return False
    before, now = states[-1 - n].position, states[-1].position
    return bool(np.hypot(now[0] - before[0], now[1] - before[1]) < _STALLED_M)


def _upright(state: RoverState) -> float:
    """Return the cosine of the body's tilt."""
    x, y, _, _ = state.quaternion
    return 1.0 - 2.0 * (x * x + y * y)


_WIDEST_PX = 480
_FASTER = 4.0
_MOST_FRAMES = 150


def write_preview(frames: Frames, path: Path) -> None:
    """Write a video (MPEG-4, .mp4) of frames at half size, four times as fast as they were taken.

    Of a long drive every so many frames are shown, 150 in all.
    """
    first = _small(frames[0], _WIDEST_PX)
    height, width = first.shape[:2]
    rate_hz = _FASTER / float(np.median(np.diff(frames.time_s))) if len(frames) > 1 else 1.0
    with replacing(path) as draft:
        code = cv2.VideoWriter.fourcc(*"mp4v")
        writer = cv2.VideoWriter(str(draft), code, min(rate_hz, 60.0), (width, height))
        if not writer.isOpened():
            raise InputError(f"{path} cannot be written as a video; look at the contact sheet instead.")
        for k in np.unique(
            np.linspace(0, len(frames) - 1, min(len(frames), _MOST_FRAMES)).round().astype(int)
        ):
            writer.write(_coloured(_small(frames[int(k)], _WIDEST_PX)))
        writer.release()


def animate_frames(frames: Frames, n_shown: int = 60) -> bytes:
    """Return frames at equal steps of the drive as an animated WebP, six a second, for a page that plays no videos."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, n_shown).round().astype(int))
    pictures = [Picture.fromarray(_coloured(_small(frames[int(k)], 400))[:, :, ::-1]) for k in chosen]
    with BytesIO() as content:
        pictures[0].save(
            content, "WEBP", save_all=True, append_images=pictures[1:], duration=167, loop=0, quality=50
        )
        return content.getvalue()


def write_contact_sheet(frames: Frames, path: Path, n_columns: int = 4, n_rows: int = 4) -> None:
    """Write a picture of frames at equal steps of the drive, each with its time."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, n_columns * n_rows).round().astype(int))
    tiles = []
    for k in chosen:
        tile = _coloured(_small(frames[int(k)], 320))
        cv2.putText(
            tile, f"{frames.time_s[k]:.2f} s", (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1
        )
        tiles.append(tile)
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % n_columns)
    rows = [np.hstack(tiles[k : k + n_columns]) for k in range(0, len(tiles), n_columns)]
    is_encoded, content = cv2.imencode(".png", np.vstack(rows))
    if not is_encoded:
        raise InputError(f"{path} cannot be written as PNG.")
    with replacing(path) as draft:
        draft.write_bytes(content.tobytes())


def _small(image: Image, widest: int) -> Image:
    """Return an image of at most that many columns, an even number a side as videos want it."""
    height, width = image.shape[:2]
    factor = min(widest / width, 1.0)
    size = (max(int(width * factor) // 2 * 2, 2), max(int(height * factor) // 2 * 2, 2))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _coloured(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image, dtype=np.uint8)
