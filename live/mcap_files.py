"""Runs and watched surveys as MCAP files for Foxglove and rerun.

Messages are JSON of Foxglove's schemas (`live.foxglove`). The frame ``local`` is the
survey's CRS with the first pose of the path as its origin, since positions in the CRS have too many digits for the
single precision of viewers; the metadata record ``frame`` holds the origin and the CRS. `write_run_mcap` writes path with
covariance, landmarks, map and its σ, images and the real path of a run, as far as it is done; `write_drive_mcap` writes places of the rover, samples with
their σ, and the map after each update of a watched survey.
"""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from pyproj import CRS

from live.foxglove import NANO, SCHEMAS, named, stamped, xyz
from live.watch.log import replayed_states
from live.watch.survey_watch import SurveyWatch
from sim.mission.fleet import drive_folders
from survey import Grid, InputError, Reconstruction, Recording, Route, SurfacePoints, Trajectory
from survey.core import FloatArray, replacing
from survey.core.run_folder import RunFolder

_FLOAT32 = 7
_FRAME = "local"


class McapMessages:
    """Messages in a local frame; channels are registered when they are first used.

    `writer`: of the file. `origin` (3,): easting, northing and height of the frame's origin [m].
    """

    def __init__(self, writer: Writer, origin: FloatArray) -> None:
        self.writer, self.origin = writer, origin
        self.counts: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def begin(self, crs: CRS) -> None:
        """Write the header, and the frame as metadata."""
        self.writer.start(profile="", library="firnline")
        east, north, up = (repr(float(value)) for value in self.origin)
        frame = {"frame_id": _FRAME, "crs": crs.to_wkt(), "east_m": east, "north_m": north, "up_m": up}
        self.writer.add_metadata("frame", frame)

    def add(self, topic: str, schema: str, time_s: float, content: dict[str, Any]) -> None:
        """Write one message.

        `time_s`: of the message [s].
        """
        if topic not in self._channels:
            text = json.dumps(SCHEMAS[schema]).encode()
            kind = self.writer.register_schema(f"foxglove.{schema}", "jsonschema", text)
            self._channels[topic] = self.writer.register_channel(topic, "json", kind)
        stamp, data = round(time_s * NANO), json.dumps(stamped(time_s, _FRAME, content)).encode()
        self.writer.add_message(self._channels[topic], stamp, data, stamp)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def add_map(self, grid: Grid, fields: tuple[FloatArray, FloatArray], time_s: float) -> None:
        """Write heights and standard deviations of a map's nodes as points, since grids of viewers are flat.

        `fields`: heights and standard deviations [m]; nodes without them are left out. `time_s`: of the map
        [s].
        """
        rows = np.column_stack([grid.xy, *(field.ravel() for field in fields)])
        rows = rows[np.isfinite(rows).all(axis=1)]
        rows[:, :3] -= self.origin
        content = {"pose": AT_ORIGIN, **packed_points(rows.astype("<f4"), ("x", "y", "z", "sigma"))}
        self.add("/map", "PointCloud", time_s, content)


AT_ORIGIN = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}


def packed_points(rows: Any, names: Sequence[str]) -> dict[str, Any]:
    """Return rows (N, K) of single precision as the fields of a point cloud."""
    size = rows.dtype.itemsize
    described = [{"name": name, "offset": size * k, "type": _FLOAT32} for k, name in enumerate(names)]
    packed = base64.b64encode(np.ascontiguousarray(rows).tobytes()).decode()
    return {"point_stride": size * len(names), "fields": described, "data": packed}


_UPRIGHT = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def write_drive_mcap(log: Path, path: Path) -> dict[str, int]:
    """Replay the log of a watch, and write what it shows."""
    with replacing(path) as draft, draft.open("wb") as stream:
        mcap: McapMessages | None = None
        for watch, entry in replayed_states(log):
            if mcap is None and watch.samples:
                mcap = McapMessages(Writer(stream), watch.xyz[0])
                mcap.begin(watch.area.crs)
            if mcap is not None and entry.get("event") == "map":
                _write_update(mcap, watch, float(entry["time_s"]))
        if mcap is None:
            raise InputError(f"{log} holds no sample that was taken; name the log of a drive.")
        _write_drive(mcap, watch)
        mcap.writer.finish()  # type: ignore[no-untyped-call]
    return mcap.counts


def _write_update(mcap: McapMessages, watch: SurveyWatch, time_s: float) -> None:
    """Write the map after an update."""
    if watch.latest_map is not None:
        mcap.add_map(watch.grid, watch.latest_map, time_s)


def _write_drive(mcap: McapMessages, watch: SurveyWatch) -> None:
    """Write where the rover was, and the samples with their standard deviations."""
    places = watch.xyz - mcap.origin
    poses = [{"position": xyz(place), "orientation": _UPRIGHT} for place in places]
    for sample, pose in zip(watch.samples, poses, strict=True):
        mcap.add("/rover1/pose", "PoseInFrame", sample.time_s, {"pose": pose})
    time_s = watch.samples[-1].time_s
    mcap.add("/rover1/path", "PosesInFrame", time_s, {"poses": poses})
    rows = np.column_stack([places, [sample.sigma_m for sample in watch.samples]]).astype("<f4")
    content = {"pose": AT_ORIGIN, **packed_points(rows, ("x", "y", "z", "sigma_z"))}
    mcap.add("/rover1/samples", "PointCloud", time_s, content)


def write_run_mcap(run: RunFolder, path: Path) -> dict[str, int]:
    """Write what a run has: path and landmarks of each rover where it is localized, images, real path, map."""
    simulated = drive_folders(run.verified("simulate"))
    places = drive_folders(run.verified("localize")) if run.has("localize") else []
    crs = Route.read(run.verified("plan") / "route.geojson").crs
    drives = [Trajectory.read(place / "trajectory.csv", crs) for place in places]
    with replacing(path) as draft, draft.open("wb") as stream:
        start = drives[0].position[0] if drives else Recording.read(simulated[0] / "recording").start
        mcap = McapMessages(Writer(stream), start)
        mcap.begin(crs)
        for rover, (place, drive) in enumerate(zip(places, drives, strict=True), start=1):
            _write_path(mcap, f"/rover{rover}", drive)
            _write_landmarks(mcap, f"/rover{rover}/landmarks", place, drive)
        for rover, place in enumerate(simulated, start=1):
            _write_images(mcap, f"/rover{rover}/image", place)
            real = Trajectory.read(place / "truth" / "trajectory.tum", crs)
            mcap.add(
                f"/rover{rover}/ground_truth/path",
                "PosesInFrame",
                float(real.time_s[-1]),
                {"poses": _poses(mcap, real)},
            )
        if run.folder("reconstruct").is_dir():
            found = Reconstruction.read(run.verified("reconstruct"))
            fields = found.mean.elevation, found.std.elevation
            mcap.add_map(found.mean.grid(), fields, float(drives[0].time_s[-1]))
        mcap.writer.finish()  # type: ignore[no-untyped-call]
    return mcap.counts


def _write_path(mcap: McapMessages, topic: str, drive: Trajectory) -> None:
    """Write each pose with the covariance of its position, and the path at its end."""
    poses = _poses(mcap, drive)
    rows = zip(drive.time_s.tolist(), poses, drive.covariance, strict=True)
    for time_s, pose, covariance in rows:
        content = {"pose": pose, "position_covariance": covariance.ravel().tolist()}
        mcap.add(f"{topic}/pose", "PoseInFrame", time_s, content)
    mcap.add(f"{topic}/path", "PosesInFrame", float(drive.time_s[-1]), {"poses": poses})


def _poses(mcap: McapMessages, drive: Trajectory) -> list[dict[str, Any]]:
    """Return the poses of a path in the local frame."""
    return [
        {"position": xyz(position), "orientation": named("xyzw", turn)}
        for position, turn in zip(drive.position - mcap.origin, drive.quaternion, strict=True)
    ]


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
