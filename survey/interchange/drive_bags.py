"""Write drives as ROS 1 bags, ROS 2 bags and MCAP files with ROS 2 messages, without ROS.

Units and axes follow REP 103, frames REP 105. ``base_link`` is the body: x forward, y left, z up. ``camera`` is an optical
frame: x right, y down, z forward. ``map`` has east, north and up from the start of the recording; ``/tf_static`` places it
in ``crs``, the projected CRS of the recording, and the sensors on ``base_link``. Real poses are on ``/ground_truth/odometry``
alone, and no transform depends on them.
"""

import heapq
import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pyproj import CRS
from scipy.spatial.transform import Rotation

from survey.core import FloatArray, InputError, replacing
from survey.core.crs import ELLIPSOIDAL
from survey.core.replacement import replacing_folder
from survey.core.transformation import transformed
from survey.data.recording import Recording, table_types
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import Wheels
from survey.data.trajectory import Trajectory
from survey.interchange.bags import require_rosbags

TRUTH_TOPIC = "/ground_truth/odometry"
_KINDS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/camera/image_raw": "sensor_msgs/msg/Image",
    "/camera/camera_info": "sensor_msgs/msg/CameraInfo",
    "/imu/data": "sensor_msgs/msg/Imu",
    "/gps/fix": "sensor_msgs/msg/NavSatFix",
    "/wheel/odometry": "nav_msgs/msg/Odometry",
    "/visual/odometry": "nav_msgs/msg/Odometry",
    "/lidar/points": "sensor_msgs/msg/PointCloud2",
    TRUTH_TOPIC: "nav_msgs/msg/Odometry",
}
_WRITTEN_TABLES = {"gps", "odometry", "wheels", "inertial", "lidar"}
_NANO = 10**9
_FIRST_S, _CLOCK_S = 1.0, 0.05
_UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])
_IN_ONE_TURN_M = 1e-3  # gauge below which no rover turns by its tracks

_Message = tuple[int, str, dict[str, Any]]
"""Time stamp [ns], topic and fields."""


def write_bag(
    recording: Recording,
    path: str | Path,
    *,
    truth: Trajectory | None = None,
    track_gauge_m: float | None = None,
) -> dict[str, int]:
    """Write a recording as a ROS 1 bag, a ROS 2 bag or an MCAP file, by the ending of its name.

    Parameters
    ----------
    recording : Recording
        Sensor records; images are read when they are written.
    path : str or pathlib.Path
        A file ``.bag`` for ROS 1, a file ``.mcap`` with ROS 2 messages, or else the folder of a ROS 2 bag (SQLite).
    truth : Trajectory, optional
        Real poses, for evaluation.
    track_gauge_m : float, optional
        Distance between the tracks [m], from which wheels get a heading. Without it wheels are left out.

    Returns
    -------
    dict of str to int
        Number of messages of each topic.

    Raises
    ------
    InputError
        rosbags is not installed, or the place cannot be written.

    Notes
    -----
    ROS takes a time stamp of 0 for unset. Stamps of a drive that begins before 1 s are shifted, so that it begins at 1 s.
    """
    drive = _Drive(recording, truth, track_gauge_m)
    with _opened(Path(path)) as bag:
        for stamp_ns, topic, fields in heapq.merge(*drive.messages(), key=lambda message: message[0]):
            bag.add(topic, stamp_ns, fields)
    return bag.counts


def bag_notes(recording: Recording, truth: Trajectory | None, track_gauge_m: float | None) -> tuple[str, ...]:
    """Return what a bag of a recording leaves out or takes as it is, a sentence each."""
    lost = [name for name in table_types() if getattr(recording, name) is not None]
    lost = [name.replace("_", " ") for name in lost if name not in _WRITTEN_TABLES]
    lost += ["wheels (no track gauge)"] if recording.wheels is not None and track_gauge_m is None else []
    notes = [f"left out, for ROS has no common message of them: {', '.join(lost)}"] if lost else []
    shift_s = _Drive(recording, truth, track_gauge_m).shift_s
    if shift_s > 0.0:
        notes.append(
            f"time stamps are {shift_s:g} s later than in the recording: ROS takes a stamp of 0 for unset"
        )
    if recording.vertical_datum != ELLIPSOIDAL:
        datum = recording.vertical_datum or "a datum that the recording does not state"
        notes.append(f"altitudes of /gps/fix count from {datum}; ROS means the ellipsoid of WGS 84")
    return tuple(notes)


class _Path(NamedTuple):
    """Poses of the body: times (N,) [s], positions (N, 3) [m] and attitudes."""

    time_s: FloatArray
    position: FloatArray
    attitude: Rotation


@dataclass(frozen=True)
class _Drive:
    """Messages of a drive, one iterator in the order of time for each topic."""

    recording: Recording
    truth: Trajectory | None
    track_gauge_m: float | None

    @cached_property
    def _times(self) -> list[FloatArray]:
        """Times of all records that are written [s]."""
        sensed = (getattr(self.recording, name) for name in (*sorted(_WRITTEN_TABLES), "frames"))
        return [records.time_s for records in (*sensed, self.truth) if records is not None]

    @cached_property
    def shift_s(self) -> float:
        """What is added to the times of the recording [s]."""
        return max(_FIRST_S - min(float(times[0]) for times in self._times), 0.0)

    def messages(self) -> Iterator[Iterator[_Message]]:
        """Yield the messages of each topic."""
        recording = self.recording
        yield self._clock()
        yield iter([(self._ns(min(times[0] for times in self._times)), "/tf_static", self._transforms())])
        yield self._fixes()
        if recording.frames is not None:
            yield self._images()
            yield self._calibrations()
        if recording.inertial is not None:
            yield self._inertial()
        if recording.lidar is not None:
            yield self._clouds()
        if recording.wheels is not None and self.track_gauge_m is not None:
            rolled = _rolled_path(recording.wheels, self.track_gauge_m)
            yield self._odometry("/wheel/odometry", "odom", rolled)
        if recording.odometry is not None:
            yield self._odometry("/visual/odometry", "odom", _joined_steps(recording.odometry))
        if self.truth is not None:
            position = self.truth.position - recording.start
            real = _Path(self.truth.time_s, position, Rotation.from_quat(self.truth.quaternion))
            yield self._odometry(TRUTH_TOPIC, "map", real)

    def _ns(self, time_s: float) -> int:
        return round((float(time_s) + self.shift_s) * _NANO)

    def _header(self, time_s: float, frame: str) -> dict[str, Any]:
        return {"stamp": _stamp(self._ns(time_s)), "frame_id": frame}

    def _clock(self) -> Iterator[_Message]:
        first, last = (f(times[k] for times in self._times) for f, k in ((min, 0), (max, -1)))
        for stamp_ns in range(self._ns(first), self._ns(last) + 1, round(_CLOCK_S * _NANO)):
            yield stamp_ns, "/clock", {"clock": _stamp(stamp_ns)}

    def _transforms(self) -> dict[str, Any]:
        """Return the mountings of the sensors, and the place of ``map`` in the CRS."""
        recording, up = self.recording, np.array([0.0, 0.0, self.recording.antenna_height_m])
        poses = {"gps": ("base_link", up, _UNTURNED), "map": ("crs", recording.start, _UNTURNED)}
        if recording.camera is not None:
            T_body_camera = recording.camera.T_body_camera
            turn = Rotation.from_matrix(T_body_camera[:3, :3]).as_quat()
            poses["camera"] = "base_link", T_body_camera[:3, 3], turn
        if recording.inertial is not None:
            poses["imu"] = "base_link", np.zeros(3), _UNTURNED
        if recording.lidar is not None:
            poses["lidar"] = "base_link", np.array(recording.lidar.scanner.mount_m), _UNTURNED
        begin_s = min(times[0] for times in self._times)
        links = [
            {
                "header": self._header(begin_s, parent),
                "child_frame_id": child,
                "transform": {"translation": _xyz(place), "rotation": _xyzw(turn)},
            }
            for child, (parent, place, turn) in poses.items()
        ]
        return {"transforms": links}

    def _images(self) -> Iterator[_Message]:
        frames = self.recording.frames
        assert frames is not None
        for k, time_s in enumerate(frames.time_s):
            pixels = np.ascontiguousarray(frames[k])
            height, width = pixels.shape[:2]
            yield self._ns(time_s), "/camera/image_raw", {
                "header": self._header(time_s, "camera"),
                "height": height,
                "width": width,
                "encoding": "mono8" if pixels.ndim == 2 else "bgr8",
                "step": pixels.size // height,
                "data": pixels,
            }  # fmt: skip

    def _calibrations(self) -> Iterator[_Message]:
        frames, camera = self.recording.frames, self.recording.camera
        assert frames is not None
        assert camera is not None
        fields = {
            "height": camera.height,
            "width": camera.width,
            "distortion_model": {"fisheye": "equidistant", "pinhole": "plumb_bob"}[camera.model],
            "d": camera.distortion,
            "k": camera.matrix,
            "r": np.eye(3),
            "p": np.column_stack([camera.matrix, np.zeros(3)]),
        }
        for time_s in frames.time_s:
            header = self._header(time_s, "camera")
            yield self._ns(time_s), "/camera/camera_info", {"header": header, **fields}

    def _inertial(self) -> Iterator[_Message]:
        inertial = self.recording.inertial
        assert inertial is not None
        rows = zip(inertial.time_s, inertial.gyro_rad_s, inertial.specific_force_m_s2, strict=True)
        no_attitude = np.r_[-1.0, np.zeros(8)]
        for time_s, rates, force in rows:
            yield self._ns(time_s), "/imu/data", {
                "header": self._header(time_s, "imu"),
                "orientation": _xyzw(_UNTURNED),
                "orientation_covariance": no_attitude,
                "angular_velocity": _xyz(rates),
                "linear_acceleration": _xyz(force),
            }  # fmt: skip

    def _fixes(self) -> Iterator[_Message]:
        """Yield fixes in degrees; covariances of east, north and up where the receiver states errors."""
        gps = self.recording.gps
        places = transformed(gps.position[:, :2], self.recording.crs, CRS.from_epsg(4326), "the fixes")
        covariance = np.zeros((len(gps), 9))
        if gps.sigma_m is not None:
            sigma_z_m = gps.sigma_m if gps.sigma_z_m is None else gps.sigma_z_m
            covariance[:, [0, 4, 8]] = np.column_stack([gps.sigma_m, gps.sigma_m, sigma_z_m]) ** 2
        for k, time_s in enumerate(gps.time_s):
            yield self._ns(time_s), "/gps/fix", {
                "header": self._header(time_s, "gps"),
                "status": {"service": 1},
                "latitude": places[k, 1],
                "longitude": places[k, 0],
                "altitude": gps.position[k, 2],
                "position_covariance": covariance[k],
                "position_covariance_type": 0 if gps.sigma_m is None else 2,
            }  # fmt: skip

    def _clouds(self) -> Iterator[_Message]:
        """Yield scans in the frame of the scanner; ``t`` is the time of a return after the stamp [s]."""
        scans = self.recording.lidar
        assert scans is not None
        names = ("x", "y", "z", "t")
        fields = [{"name": name, "offset": 4 * k, "datatype": 7, "count": 1} for k, name in enumerate(names)]
        for time_s, scan in zip(scans.time_s, scans, strict=True):
            rows = np.column_stack([scan.xyz - scan.sensor, scan.time_s - time_s]).astype("<f4")
            yield self._ns(time_s), "/lidar/points", {
                "header": self._header(time_s, "lidar"),
                "height": 1,
                "width": len(rows),
                "fields": fields,
                "point_step": rows.shape[1] * 4,
                "row_step": rows.size * 4,
                "data": np.frombuffer(rows.tobytes(), np.uint8),
                "is_dense": True,
            }  # fmt: skip

    def _odometry(self, topic: str, frame: str, path: _Path) -> Iterator[_Message]:
        """Yield poses in a frame, and velocities in the frame of the body."""
        inverse = path.attitude.inv()
        forward = inverse.apply(np.gradient(path.position, path.time_s, axis=0))
        turned = (inverse[:-1] * path.attitude[1:]).as_rotvec() / np.diff(path.time_s)[:, None]
        turning, quaternion = np.vstack([turned, turned[-1:]]), path.attitude.as_quat()
        for k, time_s in enumerate(path.time_s):
            pose = {"position": _xyz(path.position[k]), "orientation": _xyzw(quaternion[k])}
            yield self._ns(time_s), topic, {
                "header": self._header(time_s, frame),
                "child_frame_id": "base_link",
                "pose": {"pose": pose},
                "twist": {"twist": {"linear": _xyz(forward[k]), "angular": _xyz(turning[k])}},
            }  # fmt: skip


def _rolled_path(wheels: Wheels, track_gauge_m: float) -> _Path:
    """Return the path of a skid-steered rover in the plane, by its encoders alone."""
    if track_gauge_m < _IN_ONE_TURN_M:
        raise InputError(f"`track_gauge_m` is {track_gauge_m:g} m; a distance above 0 was expected.")
    heading = (wheels.right_m - wheels.left_m) / track_gauge_m
    heading -= heading[0]
    rolled, middle = np.diff(0.5 * (wheels.left_m + wheels.right_m)), 0.5 * (heading[1:] + heading[:-1])
    steps = np.column_stack([rolled * np.cos(middle), rolled * np.sin(middle), np.zeros(len(rolled))])
    position = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return _Path(wheels.time_s, position, Rotation.from_euler("z", heading[:, None]))


def _joined_steps(odometry: Odometry) -> _Path:
    """Return the path of an odometry from 0 on."""
    attitude = Rotation.from_euler("xyz", odometry.attitude_rad)
    steps = np.einsum("nij,nj->ni", attitude[:-1].as_matrix(), odometry.step)
    return _Path(odometry.time_s, np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]), attitude)


def _stamp(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // _NANO, "nanosec": time_ns % _NANO}


def _xyz(vector: FloatArray) -> dict[str, float]:
    return dict(zip("xyz", vector.tolist(), strict=True))


def _xyzw(quaternion: FloatArray) -> dict[str, float]:
    return dict(zip("xyzw", quaternion.tolist(), strict=True))


class _Bag:
    """Open bag: messages are made from dictionaries, and fields that these do not name are zero.

    `writer`: of rosbags. `store`: message types of a ROS version. `latched`: arguments of topics whose last message
    counts for those who listen later.
    """

    def __init__(
        self, writer: Any, store: Any, serialize: Callable[[Any, str], Any], latched: dict[str, Any]
    ) -> None:
        self._writer, self._store, self._serialize, self._latched = writer, store, serialize, latched
        self._connections: dict[str, Any] = {}
        self.counts: dict[str, int] = {}

    def add(self, topic: str, stamp_ns: int, fields: dict[str, Any]) -> None:
        """Write a message; its topic is added at its first one."""
        kind = _KINDS[topic]
        if topic not in self._connections:
            latched = self._latched if topic == "/tf_static" else {}
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._store, **latched
            )
        self._writer.write(
            self._connections[topic], stamp_ns, self._serialize(self._message(kind, fields), kind)
        )
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def _message(self, kind: str, values: dict[str, Any]) -> Any:
        """Return a message; ROS 1 writes some names of fields in capitals."""
        _, parts = self._store.fielddefs[kind]
        fields = {name: self._field(part, values.get(name.lower())) for name, part in parts}
        return self._store.types[kind](**fields)

    def _field(self, part: Any, value: Any) -> Any:
        """Return the value of a field of a number or text, a message, or a sequence of either."""
        node, inner = part[0].name, part[1]
        if node == "NAME":
            return self._message(inner, value or {})
        if node == "BASE":
            return ("" if inner[0] == "string" else 0) if value is None else value
        (element, name), length = inner
        if element.name == "NAME":
            return [self._message(name, each) for each in value or ()]
        return np.zeros(length, name[0]) if value is None else np.ascontiguousarray(value, name[0]).ravel()


def _opened(path: Path) -> AbstractContextManager[_Bag]:
    """Open the bag that the ending of a name states; it replaces what was there when it is complete."""
    require_rosbags(f"{path} is a bag, and writing it")
    return {".bag": _first_bag, ".mcap": _mcap_file}.get(path.suffix.lower(), _second_bag)(path)


@contextmanager
def _first_bag(path: Path) -> Iterator[_Bag]:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    links = _KINDS["/tf_static"]
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", links))
    with replacing(path) as draft, Writer(draft) as writer:
        yield _Bag(writer, store, store.serialize_ros1, {"latching": 1})


@contextmanager
def _second_bag(path: Path) -> Iterator[_Bag]:
    # The file in the folder, and the list of files, are named after the folder.
    with replacing_folder(path, own=("metadata.yaml", "*.db3")) as draft:
        with _ros2_writer(draft / path.name, "SQLITE3") as bag:
            yield bag
        for file in sorted((draft / path.name).iterdir()):
            file.replace(draft / f".{file.name}")
        (draft / path.name).rmdir()
        for file in sorted(draft.iterdir()):
            file.replace(draft / file.name.removeprefix("."))


@contextmanager
def _mcap_file(path: Path) -> Iterator[_Bag]:
    with replacing(path) as draft:
        folder = draft.parent / ".bag"
        with _ros2_writer(folder, "MCAP") as bag:
            yield bag
        next(folder.glob("*.mcap")).replace(draft)
        shutil.rmtree(folder)


@contextmanager
def _ros2_writer(folder: Path, storage: str) -> Iterator[_Bag]:
    """Open a new ROS 2 bag, of a version that Humble and later read."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    never = QosTime(2147483647, 4294967295)
    kept = Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, never, never,
        QosLiveliness.AUTOMATIC, never, avoid_ros_namespace_conventions=False,
    )  # fmt: skip
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(folder, version=8, storage_plugin=StoragePlugin[storage]) as writer:
        yield _Bag(writer, store, store.serialize_cdr, {"offered_qos_profiles": [kept]})
