"""MCAP file of a run: path with covariance, landmarks, map and its σ, images."""

import base64
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from live.export.mcap_messages import AT_ORIGIN, McapMessages, packed_points, xyz
from sim.mission.fleet import drive_folders
from survey.core.files import replacing
from survey.core.run_folder import RunFolder
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.terrain_map import Reconstruction


def write_run_mcap(run: RunFolder, path: Path) -> dict[str, int]:
    """Write what a run has: path and landmarks of each rover, images, map.

    Parameters
    ----------
    run : RunFolder
        Localized at least.
    path : pathlib.Path
        File to write.

    Returns
    -------
    dict
        Number of messages by topic.

    Raises
    ------
    InputError
        A run that is not localized yet.
    """
    places = drive_folders(run.verified("localize"))
    crs = Route.read(run.verified("plan") / "route.geojson").crs
    drives = [Trajectory.read(place / "trajectory.csv", crs) for place in places]
    with replacing(path) as draft, draft.open("wb") as stream:
        mcap = McapMessages(Writer(stream), drives[0].position[0])
        mcap.begin(crs)
        for rover, (place, drive) in enumerate(zip(places, drives, strict=True), start=1):
            _write_path(mcap, f"/rover{rover}", drive)
            _write_landmarks(mcap, f"/rover{rover}/landmarks", place, drive)
        for rover, place in enumerate(drive_folders(run.folder("simulate")), start=1):
            _write_images(mcap, f"/rover{rover}/image", place)
        if run.folder("reconstruct").is_dir():
            found = Reconstruction.read(run.verified("reconstruct"))
            fields = found.mean.elevation, found.std.elevation
            mcap.add_map(found.mean.grid(), fields, float(drives[0].time_s[-1]))
        mcap.writer.finish()  # type: ignore[no-untyped-call]
    return mcap.counts


def _write_path(mcap: McapMessages, topic: str, drive: Trajectory) -> None:
    """Write each pose with the covariance of its position, and the path at its end."""
    poses = [
        {"position": xyz(position), "orientation": dict(zip("xyzw", turn.tolist(), strict=True))}
        for position, turn in zip(drive.position - mcap.origin, drive.quaternion, strict=True)
    ]
    rows = zip(drive.time_s.tolist(), poses, drive.covariance, strict=True)
    for time_s, pose, covariance in rows:
        content = {"pose": pose, "position_covariance": covariance.ravel().tolist()}
        mcap.add(f"{topic}/pose", "PoseInFrame", time_s, content)
    mcap.add(f"{topic}/path", "PosesInFrame", float(drive.time_s[-1]), {"poses": poses})


def _write_landmarks(mcap: McapMessages, topic: str, place: Path, drive: Trajectory) -> None:
    """Write the landmarks of a drive with the standard deviation of their heights."""
    file = place / "surface_points.gpkg"
    if not file.exists():
        return
    points = SurfacePoints.read(file)
    stated = points.sigma_m if points.covariance is None else np.sqrt(points.covariance[:, 2, 2])
    rows = np.column_stack([points.xyz - mcap.origin, np.asarray(stated, dtype=np.float64)]).astype("<f4")
    content = {"pose": AT_ORIGIN, **packed_points(rows, ("x", "y", "z", "sigma_z"))}
    mcap.add(topic, "PointCloud", float(drive.time_s[-1]), content)


def _write_images(mcap: McapMessages, topic: str, place: Path) -> None:
    """Write the image files of a recording as they are."""
    folder = place / "recording"
    if not (folder / "frames").is_dir():
        return
    frames = Recording.read(folder).frames
    files = sorted((folder / "frames").glob("*.png"))
    if frames is None or len(files) != len(frames.time_s):
        return
    for time_s, file in zip(frames.time_s.tolist(), files, strict=True):
        data = base64.b64encode(file.read_bytes()).decode()
        mcap.add(topic, "CompressedImage", time_s, {"data": data, "format": "png"})
