"""Simulated drive in the vision fidelity: recording, truth, ending, and their files."""

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from sim.simulate.preview import write_contact_sheet, write_preview
from sim.world.hazards import Hazard
from survey.core.arrays import FloatArray
from survey.core.documents import write_json
from survey.data.recording import Recording
from survey.data.truth import Truth
from survey.interchange.tum_euroc import write_tum_list
from survey.io.tables import write_table
from survey.io.vector import write_features
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.onboard import write_visual_odometry

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


@dataclass(frozen=True)
class SimulatedDrive:
    """Result of a drive.

    Parameters
    ----------
    recording : Recording
        Sensor records; frames are in the drive's folder.
    truth : Truth
        Terrain and real path, 20 poses a second.
    ending : Ending
        How it ended.
    progress_m : float
        Progress along the route [m].
    energy_j : float
        Energy drawn from the battery [J].
    route_m : float
        Length of the route [m].
    hazards : tuple of Hazard
        Crevasses, channels, pools and cones of the ground.
    visual_odometry : VisualOdometry, optional
        Result of the onboard computer.
    estimates : (N, 4) ndarray, optional
        Poses that were steered by, at every frame: time [s], easting and northing [m], heading [rad].
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
        write_json(folder / "drive.json", self._summary())
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
