"""Ties between the rovers of a mission: places that their images saw from above."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import survey
from sim.config.mission import MissionConfig
from sim.mission.fleet import drive_folders
from sim.simulate.simulated_drive import ONBOARD
from survey.data.recording import Recording
from survey.data.sensors.drive_ties import DriveTies
from survey.reconstruction.joint.drives import SeveralDrives

if TYPE_CHECKING:
    from vision_slam.places.drive_ties import SeenDrive

TIES_FILE = "ties.csv"
"""Places that rovers share, in the folder of their localization; there is none where they share none."""


def find_ties(simulated: Path, localized: Path) -> None:
    """Write the places that rovers with images share."""
    from vision_slam.places.drive_ties import detect_drive_ties  # here, because OpenCV takes long to import

    seen = [_seen(place, localized / place.relative_to(simulated)) for place in drive_folders(simulated)]
    drives = [drive for drive in seen if drive is not None]
    ties = detect_drive_ties(drives) if len(drives) == len(seen) > 1 else None
    if ties is not None:
        ties.write(localized / TIES_FILE)


def _seen(simulated: Path, localized: Path) -> "SeenDrive | None":
    """Return images, odometry and path of a drive; None without images."""
    from vision_slam.odometry.onboard import read_visual_odometry
    from vision_slam.places.drive_ties import SeenDrive

    recording, odometry = Recording.read(simulated / "recording"), simulated / "recording" / ONBOARD
    if recording.frames is None or recording.camera is None or not odometry.exists():
        return None
    path = survey.Trajectory.read(localized / "trajectory.csv", recording.crs)
    return SeenDrive(recording.frames, recording.camera, read_visual_odometry(odometry), path)


def tied_drives(
    drives: SeveralDrives, paths: Sequence[survey.Trajectory], localized: Path, mission: MissionConfig
) -> SeveralDrives:
    """Return the landmarks of all rovers, corrected by the places that they share."""
    from vision_slam.fusion.drive_ties import tie_drives

    file = localized / TIES_FILE
    if drives.path is None or not file.exists():
        return drives
    return tie_drives(drives, paths, DriveTies.read(file), mission.assumed)


def n_ties(localized: Path, n_rovers: int) -> list[int]:
    """Return how many places each rover shares with others."""
    file = localized / TIES_FILE
    if not file.exists():
        return [0] * n_rovers
    ties = DriveTies.read(file)
    return [int(((ties.first == k) | (ties.second == k)).sum()) for k in range(n_rovers)]
