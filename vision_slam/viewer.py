"""Export of a localization to the viewer rerun."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from survey.core.errors import ConfigError
from survey.core.files.writing import replacing
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames
from vision_slam.drive_estimate import DriveEstimate
from vision_slam.io.sequence import VisionRecords
from vision_slam.odometry.clahe import grey_of
from vision_slam.results import health_columns

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

    Raises
    ------
    ConfigError
        rerun-sdk is not installed.
    InputError
        The file cannot be written.
    """
    refuse_without_rerun()
    import rerun as rr

    with replacing(path) as draft:
        stream = rr.RecordingStream("firnline")
        stream.save(str(draft))
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _log_path(rr, stream, estimate)
        if drive.frames is not None and drive.camera is not None:
            _log_camera(rr, stream, drive.camera)
            _log_images(rr, stream, estimate, drive.frames, drive.camera)
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


def _log_camera(rr: Any, stream: Any, camera: Camera) -> None:
    """Log mounting and lens; rerun knows pinholes alone, so that a fisheye's image is a little out of place."""
    eye = camera.T_body_camera
    stream.log("world/body/camera", rr.Transform3D(translation=eye[:3, 3], mat3x3=eye[:3, :3]), static=True)
    lens = rr.Pinhole(
        image_from_camera=camera.matrix,
        width=camera.width,
        height=camera.height,
        image_plane_distance=1.0,
    )
    stream.log("world/body/camera", lens, static=True)


def _log_images(rr: Any, stream: Any, estimate: DriveEstimate, frames: Frames, camera: Camera) -> None:
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
