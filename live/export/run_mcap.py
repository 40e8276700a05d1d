"""MCAP file of a run: path with covariance, landmarks, map and its σ, images.

Messages are JSON of Foxglove's schemas. The frame ``local`` is the survey's CRS with the first pose of the path as its
origin, since positions in the CRS have too many digits for the single precision of viewers; the metadata record ``frame``
holds the origin and the CRS.
"""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer

from live.export.schemas import SCHEMAS
from sim.mission.fleet import drive_folders
from survey.core.arrays import FloatArray
from survey.core.files.writing import replacing
from survey.core.runs.store import RunFolder
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.base import Reconstruction

_NANO, _FLOAT32 = 10**9, 7
_FRAME = "local"


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
        mcap = _Messages(Writer(stream), drives[0].position[0])
        mcap.begin(drives[0])
        for rover, (place, drive) in enumerate(zip(places, drives, strict=True), start=1):
            _write_path(mcap, f"/rover{rover}", drive)
            _write_landmarks(mcap, f"/rover{rover}/landmarks", place, drive)
        for rover, place in enumerate(drive_folders(run.folder("simulate")), start=1):
            _write_images(mcap, f"/rover{rover}/image", place)
        if run.folder("reconstruct").is_dir():
            _write_map(mcap, Reconstruction.read(run.verified("reconstruct")), float(drives[0].time_s[-1]))
        mcap.writer.finish()  # type: ignore[no-untyped-call]
    return mcap.counts


class _Messages:
    """Messages in a local frame; channels are registered when they are first used."""

    def __init__(self, writer: Writer, origin: FloatArray) -> None:
        self.writer, self.origin = writer, origin
        self.counts: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def begin(self, drive: Trajectory) -> None:
        """Write the header, and the frame as metadata."""
        self.writer.start(profile="", library="firnline")
        east, north, up = (repr(float(value)) for value in self.origin)
        frame = {"frame_id": _FRAME, "crs": drive.crs.to_wkt(), "east_m": east, "north_m": north, "up_m": up}
        self.writer.add_metadata("frame", frame)

    def add(self, topic: str, schema: str, time_s: float, content: dict[str, Any]) -> None:
        """Write one message."""
        if topic not in self._channels:
            text = json.dumps(SCHEMAS[schema]).encode()
            kind = self.writer.register_schema(f"foxglove.{schema}", "jsonschema", text)
            self._channels[topic] = self.writer.register_channel(topic, "json", kind)
        stamp = round(time_s * _NANO)
        at = {"sec": stamp // _NANO, "nsec": stamp % _NANO}
        data = json.dumps({"timestamp": at, "frame_id": _FRAME, **content}).encode()
        self.writer.add_message(self._channels[topic], stamp, data, stamp)
        self.counts[topic] = self.counts.get(topic, 0) + 1


def _write_path(mcap: _Messages, topic: str, drive: Trajectory) -> None:
    """Write each pose with the covariance of its position, and the path at its end."""
    poses = [
        {"position": _xyz(position), "orientation": dict(zip("xyzw", turn.tolist(), strict=True))}
        for position, turn in zip(drive.position - mcap.origin, drive.quaternion, strict=True)
    ]
    rows = zip(drive.time_s.tolist(), poses, drive.covariance, strict=True)
    for time_s, pose, covariance in rows:
        content = {"pose": pose, "position_covariance": covariance.ravel().tolist()}
        mcap.add(f"{topic}/pose", "PoseInFrame", time_s, content)
    mcap.add(f"{topic}/path", "PosesInFrame", float(drive.time_s[-1]), {"poses": poses})


def _write_landmarks(mcap: _Messages, topic: str, place: Path, drive: Trajectory) -> None:
    """Write the landmarks of a drive with the standard deviation of their heights."""
    file = place / "surface_points.gpkg"
    if not file.exists():
        return
    points = SurfacePoints.read(file)
    stated = points.sigma_m if points.covariance is None else np.sqrt(points.covariance[:, 2, 2])
    rows = np.column_stack([points.xyz - mcap.origin, np.asarray(stated, dtype=np.float64)]).astype("<f4")
    content = {"pose": _AT_ORIGIN, **_packed(rows, ("x", "y", "z", "sigma_z"))}
    mcap.add(topic, "PointCloud", float(drive.time_s[-1]), content)


def _write_map(mcap: _Messages, found: Reconstruction, time_s: float) -> None:
    """Write heights and standard deviations of the map's nodes as points, since grids of viewers are flat."""
    grid = found.mean.grid()
    columns = [grid.xy, found.mean.elevation.reshape(-1, 1), found.std.elevation.reshape(-1, 1)]
    rows = np.hstack(columns)
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows[:, :3] -= mcap.origin
    content = {"pose": _AT_ORIGIN, **_packed(rows.astype("<f4"), ("x", "y", "z", "sigma"))}
    mcap.add("/map", "PointCloud", time_s, content)


def _write_images(mcap: _Messages, topic: str, place: Path) -> None:
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


_AT_ORIGIN = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}


def _xyz(position: FloatArray) -> dict[str, float]:
    return dict(zip("xyz", position.tolist(), strict=True))


def _packed(rows: Any, names: Sequence[str]) -> dict[str, Any]:
    """Return rows (N, K) of single precision as the fields of a point cloud."""
    size = rows.dtype.itemsize
    described = [{"name": name, "offset": size * k, "type": _FLOAT32} for k, name in enumerate(names)]
    packed = base64.b64encode(np.ascontiguousarray(rows).tobytes()).decode()
    return {"point_stride": size * len(names), "fields": described, "data": packed}
