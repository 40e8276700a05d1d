"""Output files of a localization: path, landmarks, frame health, figures, and a file for the viewer rerun.

`write_localization` writes files named in `OWN_FILES`, to which the pictures of `draw_localization` belong. `write_rrd` needs the package rerun-sdk,
which is imported when it is called. Rerun has pinhole cameras only, so that a fisheye image is a little out of place.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from survey.core import ConfigError, FloatArray, picture_files, replacing
from survey.data.ice_motion import ICE_MOTION, write_motion
from survey.data.sensors.records import GpsFixes
from survey.figures.paths import error_over_distance, path_map
from survey.io.tables import write_table
from survey.io.trajectory_files import write_track, write_tum
from vision_slam.drive_estimate import DriveEstimate
from vision_slam.evaluation import Comparison
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.tracks import grey_of
from vision_slam.plotting import features_on_photographs, tracks_on_frames
from vision_slam.readers.sequence import VisionRecords

OWN_FILES = (
    *(
        "trajectory.tum", "trajectory.csv", "trajectory.error.npz", "path.csv", "online_trajectory.csv",
        "track.gpkg",
    ),
    *("trajectory_fixed.csv", ICE_MOTION),
    *("health.csv", "landmarks.csv", "landmarks.gpkg", *picture_files("map", "tracks", "features", "errors")),
)  # fmt: skip
"""Names of all files that a localization consists of."""


def write_localization(folder: Path, estimate: DriveEstimate) -> None:
    """Write path, landmarks and frame health into an empty folder.

    With a CRS there are also ``trajectory.csv`` with covariances, ``online_trajectory.csv``
    with the causal path, ``track.gpkg`` and ``landmarks.gpkg``, but no landmarks where the fixes contradict the images
    too much; without, ``path.csv`` has the
    standard deviations of the positions relative to the first. On moving ice they are those of the
    epoch; ``trajectory_fixed.csv`` is the path in fixed coordinates, ``ice_motion.json`` the motion.
    """
    if estimate.trajectory is not None:
        estimate.trajectory.write(folder / "trajectory.csv")
        write_track(folder / "track.gpkg", estimate.time_s, estimate.position, estimate.trajectory.crs)
    elif estimate.covariance is not None:
        sigma_m = np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2))
        columns = dict(zip(("x_m", "y_m", "z_m"), estimate.position.T, strict=True))
        columns |= dict(zip(("sigma_x_m", "sigma_y_m", "sigma_z_m"), sigma_m.T, strict=True))
        write_table(folder / "path.csv", {"time_s": estimate.time_s} | columns)
    if estimate.ice_motion is not None and estimate.fixed_trajectory is not None:
        write_motion(estimate.ice_motion, folder / ICE_MOTION)
        estimate.fixed_trajectory.write(folder / "trajectory_fixed.csv")
    if estimate.online is not None:
        estimate.online.write(folder / "online_trajectory.csv")
    _write_landmarks(folder, estimate)
    if estimate.visual_odometry is not None:
        write_table(folder / "health.csv", health_columns(estimate.visual_odometry))
    poses = np.column_stack([estimate.time_s, estimate.position, estimate.quaternion])
    write_tum(folder / "trajectory.tum", poses)


def _write_landmarks(folder: Path, estimate: DriveEstimate) -> None:
    if estimate.points is not None:
        estimate.points.write(folder / "landmarks.csv")
        estimate.points.write(folder / "landmarks.gpkg")
        return
    if estimate.trajectory is not None:  # they do not hold
        return
    x, y, z = estimate.landmarks.T
    columns = {"x_m": x, "y_m": y, "z_m": z, "sigma_z_m": estimate.sigma_z_m}
    write_table(folder / "landmarks.csv", columns)


_HEALTH = ("entropy_bits", "saturated", "sharpness", "n_followed", "n_inliers", "is_visual")


def health_columns(visual: VisualOdometry) -> dict[str, FloatArray]:
    """Return the columns of the health table, one row per frame."""
    columns = {name: np.array([getattr(frame, name) for frame in visual.health], float) for name in _HEALTH}
    return {"time_s": visual.odometry.time_s} | columns | {"is_lost": visual.is_lost.astype(float)}


def draw_localization(
    estimate: DriveEstimate,
    drive: VisionRecords,
    gps: GpsFixes | None = None,
    comparison: Comparison | None = None,
) -> dict[str, Figure]:
    """Draw tracks on frames, or features that photographs share, the map with its ellipses and, with a reference, errors over distance."""
    pictures = {
        "map": path_map(
            estimate.position,
            estimate.covariance,
            landmarks=estimate.landmarks,
            landmark_sigma_m=estimate.sigma_z_m,
            fixes=None if gps is None else gps.position,
            reference=None if comparison is None else comparison.reference,
            is_lost=estimate.is_lost,
            crs=None if estimate.trajectory is None else estimate.trajectory.crs,
            in_the_world=estimate.trajectory is not None,
        )
    }
    if drive.frames is not None and len(drive.frames) > 1:
        if estimate.visual_odometry is None:
            pictures["features"] = features_on_photographs(drive.frames)
        else:
            pictures["tracks"] = tracks_on_frames(drive)
    if comparison is not None:
        pictures["errors"] = error_over_distance(
            comparison.position, comparison.reference, comparison.covariance, comparison.is_lost
        )
    return pictures


_LINE = "drive"


def refuse_without_rerun() -> None:
    """Refuse before any work starts when there is nothing to write the file with."""
    try:
        import rerun  # noqa: F401
    except ImportError as error:
        raise ConfigError(
            "--viewer needs rerun-sdk, which is not installed; install firnline[viewer]."
        ) from error


def write_rrd(path: Path, estimate: DriveEstimate, drive: VisionRecords) -> None:
    """Write an ``.rrd`` file, which ``rerun FILE`` opens.

    Places count from the first pose: rerun computes in single precision, which cuts
    eastings and northings to half a metre.
    """
    refuse_without_rerun()
    import rerun as rr

    with replacing(path) as draft:
        stream = rr.RecordingStream("firnline")
        stream.save(str(draft))
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _log_path(rr, stream, estimate)
        _log_images(rr, stream, estimate, drive)
        _log_health(rr, stream, estimate)
        stream.flush()
        stream.disconnect()


def _log_path(rr: Any, stream: Any, estimate: DriveEstimate) -> None:
    """Log the path and the landmarks, and the body's pose over time."""
    origin = estimate.position[0]
    stream.log("world/path", rr.LineStrips3D([estimate.position - origin]), static=True)
    if len(estimate.landmarks):
        stream.log("world/landmarks", rr.Points3D(estimate.landmarks - origin, radii=0.03), static=True)
    stream.send_columns(
        "world/body",
        indexes=[rr.TimeColumn(_LINE, duration=estimate.time_s - estimate.time_s[0])],
        columns=rr.Transform3D.columns(
            translation=estimate.position - origin, quaternion=estimate.quaternion
        ),
    )


def _log_images(rr: Any, stream: Any, estimate: DriveEstimate, drive: VisionRecords) -> None:
    """Log mounting, lens and images; rerun knows pinholes alone, so that a fisheye's image is a little out of place."""
    frames, camera = drive.frames, drive.camera
    if frames is None or camera is None:
        return
    eye = camera.T_body_camera
    stream.log("world/body/camera", rr.Transform3D(translation=eye[:3, 3], mat3x3=eye[:3, :3]), static=True)
    lens = rr.Pinhole(
        image_from_camera=camera.matrix, width=camera.width, height=camera.height, image_plane_distance=1.0
    )
    stream.log("world/body/camera", lens, static=True)
    for index, time_s in enumerate(frames.time_s.tolist()):
        stream.set_time(_LINE, duration=time_s - estimate.time_s[0])
        grey = grey_of(frames[index], camera.width, camera.height)
        _, content = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 85])
        image = rr.EncodedImage(contents=content.tobytes(), media_type="image/jpeg")
        stream.log("world/body/camera", image)


def _log_health(rr: Any, stream: Any, estimate: DriveEstimate) -> None:
    if estimate.visual_odometry is None:
        return
    columns = health_columns(estimate.visual_odometry)
    time_s = columns.pop("time_s")
    for name, values in columns.items():
        stream.send_columns(
            f"health/{name}",
            indexes=[rr.TimeColumn(_LINE, duration=time_s - estimate.time_s[0])],
            columns=rr.Scalars.columns(scalars=np.asarray(values)),
        )
