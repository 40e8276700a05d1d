"""Localization of one drive: path, landmarks and scan points from its recording, and the score of its path.

Each function reads the files of a drive and writes or returns its own: recording ──▶ trajectory, landmarks, points of
scans ──▶ map with its age ──▶ scores of the path.
"""

from pathlib import Path
from typing import Any

import numpy as np

import survey
import vision_slam
from sim.config.mission import MissionConfig
from sim.simulate.simulated_drive import ONBOARD
from sim.world.moving_ice import assumed_motion, epoch_of
from survey.data.ice_motion import ICE_MOTION, read_motion, write_motion
from survey.reconstruction.line_of_sight.scan_points import BeamErrors, scan_points
from survey.reconstruction.method import MappedTerrain
from survey.reconstruction.motion.epoch import in_fixed_frame, with_age
from survey.reconstruction.motion.refinement import refined_motion
from vision_slam.drive_estimate import Localization
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.onboard import read_visual_odometry
from vision_slam.places.loop_closures import SeenDrive

LANDMARKS, SCAN_POINTS = "surface_points.gpkg", "scan_points.gpkg"
"""Points that a drive is localized with, and those of its LiDAR scans."""


def localize_drive(mission: MissionConfig, simulated: Path, folder: Path) -> None:
    """Estimate path and landmarks from a recording, and from nothing else; write the causal path too.

    Images that the onboard computer has looked at are not looked at again.
    """
    recording = survey.Recording.read(simulated / "recording")
    seen = simulated / "recording" / ONBOARD
    visual = read_visual_odometry(seen) if seen.exists() else None
    result = localize_recording(recording, mission, visual)
    if result.ice_motion is not None:
        write_motion(result.ice_motion, folder / ICE_MOTION)
        in_fixed_frame(result.trajectory, result.ice_motion).write(folder / "trajectory_fixed.csv")
    if result.online_trajectory is not None:
        result.online_trajectory.write(folder / "online_trajectory.csv")
    result.trajectory.write(folder / "trajectory.tum")
    result.trajectory.write(folder / "trajectory.csv")
    result.points.write(folder / LANDMARKS)
    if recording.lidar is not None:
        register_scans(recording, result.trajectory, mission).write(folder / SCAN_POINTS)


def localize_recording(
    recording: survey.Recording, mission: MissionConfig, visual: VisualOdometry | None = None
) -> Localization:
    """Localize a recording, with the motion of the ice where the mission has moving ice."""
    if mission.ice is None:
        return vision_slam.localize(recording, mission.assumed, visual=visual)
    places = np.vstack([recording.start, recording.gps.position])[:, :2]
    prior = assumed_motion(
        mission.ice.assumed, epoch_of(recording, mission), places, recording.crs, path_of=mission.path
    )
    return vision_slam.localize(recording, mission.assumed, motion=prior, visual=visual)


def with_ice_motion(localized: Path, mapped: MappedTerrain, folder: Path) -> MappedTerrain:
    """Write the motion of the ice after the map of one drive, and return the map with its age; as it is on ice at rest."""
    if not (localized / ICE_MOTION).exists() or mapped.solution is None:
        return mapped
    motion = refined_motion(read_motion(localized / ICE_MOTION), mapped.solution)
    write_motion(motion, folder / ICE_MOTION)
    return mapped._replace(reconstruction=with_age(mapped.reconstruction, motion))


def register_scans(
    recording: survey.Recording, path: survey.Trajectory, mission: MissionConfig
) -> survey.SurfacePoints:
    """Return the points that the scans of a recording become by the estimated path."""
    lidar = recording.lidar
    if lidar is None:
        raise survey.InputError(
            "the recording has no LiDAR scans; set sensors.lidar.beams and simulate again."
        )
    errors = BeamErrors.of(lidar.scanner)
    config = mission.reconstruction.scans
    return scan_points(lidar, path, errors, config=config, vertical_datum=recording.vertical_datum)


def mapped_points(localized: Path) -> survey.SurfacePoints:
    """Return the points of a drive that are mapped: those of its scans, or its landmarks where it has none."""
    scans = localized / SCAN_POINTS
    return survey.SurfacePoints.read(scans if scans.exists() else localized / LANDMARKS)


def path_scores(simulated: Path, localized: Path, mapped: Path) -> dict[str, Any]:
    """Judge the path of one drive against the truth: as localized, after the map's correction, and as known on the way."""
    truth = survey.Truth.read(simulated / "truth")
    files = {
        "": localized / "trajectory.csv",
        "after_mapping_": mapped / "corrected_trajectory.csv",
        "online_": localized / "online_trajectory.csv",
    }
    scores: dict[str, Any] = {}
    for prefix, file in files.items():
        if file.exists():
            path = survey.Trajectory.read(file, truth.dem.crs)
            if (localized / ICE_MOTION).exists():
                path = in_fixed_frame(path, read_motion(localized / ICE_MOTION))
            found = vision_slam.trajectory_error(path, truth.trajectory).to_dict()
            scores |= {f"{prefix}{name}": value for name, value in found.items()}
    return scores


def seen_drive(simulated: Path, localized: Path) -> SeenDrive | None:
    """Return images, odometry and path of a drive; None without images."""
    recording, odometry = survey.Recording.read(simulated / "recording"), simulated / "recording" / ONBOARD
    if recording.frames is None or recording.camera is None or not odometry.exists():
        return None
    path = survey.Trajectory.read(localized / "trajectory.csv", recording.crs)
    return SeenDrive(recording.frames, recording.camera, read_visual_odometry(odometry), path)
