"""ROS 1 and ROS 2 bags, read without ROS: images, calibration, fixes, inertial readings, odometry.

The first functions decode messages: pixels, calibration, odometry and transforms. `read_bag` chooses topics by their type
and reads a bag in one pass; images are decoded when they are used. `bag_fixes` returns the fixes with their stated standard
deviations, and `in_order` leaves out messages that repeat a time or come late. Point clouds in bags are read by
`survey.interchange`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from survey import Camera, InputError
from survey.core import BoolArray, FloatArray, IntArray
from survey.core.crs import ELLIPSOIDAL
from survey.data.frames import Frames, Image
from survey.data.sensors.records import Inertial, Wheels
from survey.interchange.bags import open_bag
from vision_slam.readers.calibrations import FORWARD
from vision_slam.readers.images import bits_used, decoded, eight_bits, scaling_note
from vision_slam.readers.sequence import GpsLog, ImageSequence, MotionRecords

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader


IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
# Channels, and how OpenCV turns them into grey or blue-green-red; None leaves them.
_ENCODINGS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "mono16": (1, None),
    "16UC1": (1, None),
    "bgr8": (3, None),
    "8UC3": (3, None),
    "bgr16": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "rgb16": (3, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUY2),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2BGR),
}


def decode_pixels(message: Any, msgtype: str, where: str) -> npt.NDArray[Any]:
    """Return the pixels of an image message, grey or blue-green-red."""
    if msgtype == COMPRESSED:
        return decoded(bytes(message.data), where)
    if message.encoding not in _ENCODINGS:
        raise InputError(
            f"{where} has the encoding {message.encoding!r}; one of {', '.join(_ENCODINGS)} was expected, convert it."
        )
    channels, conversion = _ENCODINGS[message.encoding]
    depth = np.dtype(np.uint16 if "16" in message.encoding else np.uint8)
    depth = depth.newbyteorder(">" if message.is_bigendian else "<")
    used = message.width * channels * depth.itemsize
    if message.step < used or len(message.data) < message.step * message.height:
        raise InputError(
            f"{where} is cut off: {len(message.data)} bytes for {message.width} × {message.height} pixels."
        )
    rows = np.frombuffer(bytes(message.data), np.uint8)[: message.step * message.height]
    rows = np.ascontiguousarray(rows.reshape(message.height, message.step)[:, :used])
    pixels: npt.NDArray[Any] = rows.view(depth).astype(depth.newbyteorder("="))
    if channels > 1:
        pixels = pixels.reshape(message.height, message.width, channels)
    return pixels if conversion is None else np.asarray(cv2.cvtColor(pixels, conversion))


def decode_camera(info: Any, mounted: FloatArray, place: Path) -> Camera:
    """Return the calibration from a CameraInfo, whose fields are named in capitals in ROS 1."""
    matrix, lens = (
        np.asarray(getattr(info, n, getattr(info, n.upper(), None)), dtype=float) for n in ("k", "d")
    )
    if matrix.size != 9 or matrix.ravel()[0] <= 0.0:
        raise InputError(
            f"{place} has a camera_info without a calibration; calibrate, or name one with --camera."
        )
    if info.distortion_model in {"equidistant", "fisheye"}:
        return Camera("fisheye", info.width, info.height, matrix.reshape(3, 3), _padded(lens, 4), mounted)
    if len(lens) > 5 and np.any(lens[5:]):
        raise InputError(
            f"{place} has the distortion model {info.distortion_model!r} with {len(lens)} coefficients; "
            "plumb_bob or equidistant was expected, rectify the images or calibrate again."
        )
    coefficients, is_assumed = _padded(lens, 5), lens.size == 0
    return Camera(
        "pinhole",
        info.width,
        info.height,
        matrix.reshape(3, 3),
        coefficients,
        mounted,
        distortion_is_assumed=is_assumed,
    )


def decode_fix_sigma_m(message: Any) -> float:
    """Return the horizontal standard deviation in each axis [m] of a NavSatFix; 0 where it states no covariance."""
    east_m2, north_m2 = message.position_covariance[0], message.position_covariance[4]
    is_stated = message.position_covariance_type > 0 and east_m2 > 0.0 and north_m2 > 0.0
    return float(np.sqrt(0.5 * (east_m2 + north_m2))) if is_stated else 0.0


def _padded(coefficients: FloatArray, n: int) -> FloatArray:
    padded: FloatArray = np.r_[coefficients, np.zeros(n)][:n]
    return padded


def decode_wheels(rows: list[tuple[float, ...]]) -> Wheels:
    """Return the distance along the body's own forward axis, summed."""
    table = np.array(rows)
    forward = Rotation.from_quat(table[:-1, 4:]).apply([1.0, 0.0, 0.0])
    steps = np.einsum("ni,ni->n", forward, np.diff(table[:, 1:4], axis=0))
    travel = np.r_[0.0, np.cumsum(steps)]
    return Wheels(table[:, 0], travel, travel)


def decode_transform(message: Any) -> tuple[str, FloatArray]:
    """Return the parent frame, and the child's pose in it."""
    shift, turn = message.transform.translation, message.transform.rotation
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    pose[:3, 3] = shift.x, shift.y, shift.z
    return message.header.frame_id.lstrip("/"), pose


def stamp_s(stamp: Any) -> float:
    """Return a time stamp in seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


_KINDS = {
    "images": (IMAGE, COMPRESSED),
    "calibration": ("sensor_msgs/msg/CameraInfo",),
    "fixes": ("sensor_msgs/msg/NavSatFix",),
    "inertial": ("sensor_msgs/msg/Imu",),
    "odometry": ("nav_msgs/msg/Odometry",),
}
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_SAMPLED_EVERY = 10  # images that are checked for size and depth before any is used
_MOST_NAMED = 8
_BASES = ("base_footprint", "base_link")
_TRUTH = "truth"  # in the names of topics of real poses, which no estimate may use


def is_bag(path: Path) -> bool:
    """Return whether a path is a ROS 1 bag, a folder of one split into files, or a ROS 2 bag's folder or file.

    >>> is_bag(Path("drive.bag")), is_bag(Path("drive.csv"))
    (True, False)
    """
    if path.suffix in {".bag", ".mcap", ".db3"}:
        return True
    is_second = (path / "metadata.yaml").is_file() and any(path.glob("*.mcap*")) | any(path.glob("*.db3*"))
    return is_second or bool(_split_files(path))


def _split_files(folder: Path) -> list[Path]:
    """Return the files of a folder that holds one ROS 1 recording split by rosbag, ``…_0.bag``, ``…_1.bag`` and so on."""
    if not folder.is_dir():
        return []
    files = {file.stem.rpartition("_")[2]: file for file in folder.iterdir() if not file.name.startswith(".")}
    numbers = [str(number) for number in range(len(files))]
    is_split = set(files) == set(numbers) and all(file.suffix == ".bag" for file in files.values())
    return [files[number] for number in numbers] if is_split else []


def read_bag(
    path: str | Path, topics: Sequence[str] = (), camera: Camera | None = None
) -> ImageSequence | MotionRecords:
    """Read a bag; topics are recognized by their type.

    Images are raw or compressed (`sensor_msgs`) and are decoded when they are used;
    calibration, fixes, inertial readings and odometry are read at once. Fixes most of which state a
    covariance have its horizontal standard deviation, and those without one the largest, with a note. Poses of an odometry
    count as wheels: only the distance between them is used. Where ``/tf_static`` has the
    mounting of camera and inertial unit on ``base_link``, both are rotated into the body frame;
    else the camera is assumed level and forward, and the inertial unit aligned with the body,
    and a note is added. Topics of real poses (``truth`` in their names) are read only where they are named. Messages that repeat a time or come late are left out, with a note. A bag without images
    gives its odometry, inertial readings and fixes.
    """
    place = Path(path)
    has_folder = place.suffix in {".mcap", ".db3"} and (place.parent / "metadata.yaml").is_file()
    place = place.parent if has_folder else place
    with open_bag(place, _split_files(place)) as reader:
        taken = _chosen_topics(reader.connections, topics, place)
        if not taken.keys() & {"images", "odometry", "fixes"}:
            raise InputError(
                f"{place} holds neither images (sensor_msgs Image or CompressedImage), nor wheels (nav_msgs Odometry), nor fixes "
                "(sensor_msgs NavSatFix); name another bag."
            )
        found = _read_messages(reader, taken)
        unread = sorted(
            {f"{one.topic} ({one.msgtype})" for one in reader.connections}
            - {f"{topic} ({kind})" for name, topic in taken.items() for kind in _KINDS[name]}
            - {f"/tf_static ({_TRANSFORMS})"}
        )
    if unread:
        found.notes.append(f"not read: {', '.join(unread[:_MOST_NAMED])}{_and_more(len(unread))}")
    return _sequence(place, taken, found, camera) if "images" in taken else _motion(place, taken, found)


@dataclass
class _Found:
    """Records of one pass over the bag."""

    stamps: list[float]
    image_frame: str
    size: tuple[int, int]
    shift: int
    calibration: Any
    fixes: list[tuple[float, ...]]
    n_without_fix: int
    inertial: list[tuple[float, ...]]
    inertial_frame: str
    odometry: list[tuple[float, ...]]
    mounted: dict[str, tuple[str, FloatArray]]
    notes: list[str] = field(default_factory=list)


def _and_more(n: int) -> str:
    return f" and {n - _MOST_NAMED} more" if n > _MOST_NAMED else ""


def _chosen_topics(connections: Sequence[Any], topics: Sequence[str], place: Path) -> dict[str, str]:
    """Choose one topic for each kind of record."""
    unknown = [topic for topic in topics if topic not in {connection.topic for connection in connections}]
    if unknown:
        have = ", ".join(sorted({connection.topic for connection in connections}))
        raise InputError(f"{place} has no topic {unknown[0]} (it has {have}); correct --topic.")
    taken: dict[str, str] = {}
    for kind, types in _KINDS.items():
        fitting = {connection.topic for connection in connections if connection.msgtype in types}
        named = fitting.intersection(topics) or {topic for topic in fitting if _TRUTH not in topic.lower()}
        if kind == "calibration" and len(named) > 1 and "images" in taken:
            named = {topic for topic in named if _is_beside(topic, taken["images"])} or named
        if len(named) > 1:
            raise InputError(
                f"{place} has {len(named)} topics of {kind} ({', '.join(sorted(named))}); choose one with --topic."
            )
        if named:
            taken[kind] = next(iter(named))
    return taken


def _is_beside(calibration: str, images: str) -> bool:
    """Return whether a topic of calibration belongs to the camera of a topic of images by its name."""
    return calibration.rsplit("/", 1)[0] == images.split("/image", maxsplit=1)[0]


def _messages(reader: "AnyReader", connections: list[Any]) -> Iterator[tuple[Any, int, Any]]:
    """Read messages in the order of the bag."""
    for connection, time_ns, raw in reader.messages(connections=connections):
        yield connection, time_ns, reader.deserialize(raw, connection.msgtype)


def _read_messages(reader: "AnyReader", taken: dict[str, str]) -> _Found:
    """Read everything but the images, of which only the times.

    A topic has several connections where its publisher was restarted or where the bag is split.
    """
    found = _Found([], "", (0, 0), 0, None, [], 0, [], "", [], {})
    kind_of = {(topic, msgtype): kind for kind, topic in taken.items() for msgtype in _KINDS[kind]}
    kind_of["/tf_static", _TRANSFORMS] = "transforms"
    used = [one for one in reader.connections if (one.topic, one.msgtype) in kind_of]
    for connection, time_ns, message in _messages(reader, used):
        kind = kind_of[connection.topic, connection.msgtype]
        if kind == "transforms":
            for link in message.transforms:
                found.mounted[link.child_frame_id.lstrip("/")] = decode_transform(link)
            continue
        stamp = stamp_s(message.header.stamp) or 1e-9 * time_ns
        _noted(found, kind, stamp, message, connection.msgtype)
    return found


def _noted(found: _Found, kind: str, stamp: float, message: Any, msgtype: str) -> None:
    if kind == "images":
        if len(found.stamps) % _SAMPLED_EVERY == 0:
            pixels = decode_pixels(message, msgtype, f"the image at {stamp:.3f} s")
            found.size = (pixels.shape[1], pixels.shape[0])
            found.shift = max(found.shift, bits_used(pixels) - 8 if pixels.dtype == np.uint16 else 0)
        found.stamps.append(stamp)
        found.image_frame = message.header.frame_id.lstrip("/")
    elif kind == "calibration":
        found.calibration = message
    elif kind == "fixes":
        place = (message.longitude, message.latitude, message.altitude)
        if message.status.status < 0 or not np.isfinite(place).all():
            found.n_without_fix += 1
        else:
            found.fixes.append((stamp, *place, decode_fix_sigma_m(message)))
    elif kind == "inertial":
        rate, force = message.angular_velocity, message.linear_acceleration
        found.inertial.append((stamp, rate.x, rate.y, rate.z, force.x, force.y, force.z))
        found.inertial_frame = message.header.frame_id.lstrip("/")
    else:
        at = message.pose.pose.position
        turn = message.pose.pose.orientation
        found.odometry.append((stamp, at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w))


def _ordered(found: _Found, taken: dict[str, str], notes: list[str]) -> IntArray:
    """Leave out repeated and late messages, with a note; return the numbers of the images that stay."""
    for kind, rows in (("fixes", found.fixes), ("inertial", found.inertial), ("odometry", found.odometry)):
        stays = in_order([row[0] for row in rows])
        rows[:] = [row for row, is_later in zip(rows, stays, strict=True) if is_later]
        _note_left_out(notes, taken.get(kind, kind), stays)
    stays = in_order(found.stamps)
    _note_left_out(notes, taken.get("images", "images"), stays)
    return np.flatnonzero(stays)


def _note_left_out(notes: list[str], topic: str, stays: BoolArray) -> None:
    if not stays.all():
        notes.append(
            f"{int((~stays).sum())} messages of {topic} repeat a time or come late, and are left out"
        )


def _sequence(place: Path, taken: dict[str, str], found: _Found, camera: Camera | None) -> ImageSequence:
    notes = [*(f"{kind} from {topic}" for kind, topic in taken.items()), *found.notes]
    numbers = _ordered(found, taken, notes)
    if camera is None:
        if found.calibration is None:
            raise InputError(f"{place} holds no camera_info; name a calibration with --camera.")
        if not taken["images"].startswith(taken["calibration"].rsplit("/", 1)[0] + "/"):
            notes.append(
                f"no camera_info is beside {taken['images']}: that of {taken['calibration']} is taken, which may be another camera's"
            )
        mounted = _on_body(found, found.image_frame)
        if mounted is None:
            notes.append("the bag has no mounting of the camera: it is assumed to look forward, level")
        camera = decode_camera(found.calibration, FORWARD if mounted is None else mounted, place)
    if found.size != (camera.width, camera.height):
        raise InputError(
            f"{place} has images of {found.size[0]} × {found.size[1]} pixels, their calibration {camera.width} × {camera.height}; "
            "name one for this size with --camera."
        )
    if found.shift:
        notes.append(scaling_note(found.shift))
    beside = _motion_of(place, found, notes)
    return ImageSequence(
        camera,
        Frames(np.array(found.stamps)[numbers], _BagImages(place, taken["images"], found.shift, numbers)),
        **beside,
        notes=tuple(notes),
    )


def _motion(place: Path, taken: dict[str, str], found: _Found) -> MotionRecords:
    """Return the records of a bag without images."""
    notes = [*(f"{kind} from {topic}" for kind, topic in taken.items()), *found.notes]
    _ordered(found, taken, notes)
    beside = _motion_of(place, found, notes)
    return MotionRecords(**beside, notes=tuple(notes))


class _Motion(TypedDict):
    wheels: Wheels | None
    inertial: Inertial | None
    gps: GpsLog | None


def _motion_of(place: Path, found: _Found, notes: list[str]) -> _Motion:
    """Return wheels, inertial readings in the axes of the body, and fixes; add notes of what was assumed."""
    gps = None
    if found.fixes or found.n_without_fix:
        gps = bag_fixes(found.fixes, found.n_without_fix, place)
    inertial = None
    if found.inertial:
        rows, turned = np.array(found.inertial), _on_body(found, found.inertial_frame)
        if turned is None:
            notes.append(
                "the bag has no mounting of the inertial unit: it is assumed to have the axes of the body"
            )
        turn = np.eye(3) if turned is None else turned[:3, :3]
        inertial = Inertial(rows[:, 0], rows[:, 1:4] @ turn.T, rows[:, 4:7] @ turn.T)
    wheels = decode_wheels(found.odometry) if len(found.odometry) > 1 else None
    return {"wheels": wheels, "inertial": inertial, "gps": gps}


class _BagImages:
    """Images of a topic by their numbers; the bag is read once for images in their order, and from its beginning for an earlier one."""

    def __init__(self, place: Path, topic: str, shift: int, numbers: IntArray) -> None:
        self._place, self._topic, self._shift, self._numbers = place, topic, shift, numbers
        self._next, self._images = 0, self._read()
        self._last = np.zeros((0, 0), np.uint8)

    def __getitem__(self, index: int) -> Image:
        number = int(self._numbers[index])
        if number < self._next - 1:
            self._next, self._images = 0, self._read()
        while self._next <= number:
            self._last = next(self._images)
            self._next += 1
        return self._last

    def _read(self) -> Iterator[Image]:
        with open_bag(self._place, _split_files(self._place)) as reader:
            chosen = [
                one
                for one in reader.connections
                if one.topic == self._topic and one.msgtype in _KINDS["images"]
            ]
            for number, (connection, _, message) in enumerate(_messages(reader, chosen)):
                where = f"{self._place}, image {number} of {self._topic}"
                yield eight_bits(decode_pixels(message, connection.msgtype, where), self._shift, where)


def _on_body(found: _Found, frame: str) -> FloatArray | None:
    """Return the pose of a frame on the body by the static transforms; None where they do not reach it."""
    pose: FloatArray = np.eye(4)
    for _ in range(len(found.mounted) + 1):
        if frame in _BASES:
            return pose
        if frame not in found.mounted:
            return None
        frame, link = found.mounted[frame]
        pose = link @ pose
    return None


_LEAST_STATED = 0.5


def bag_fixes(rows: Sequence[tuple[float, ...]], n_without_fix: int, place: Path) -> GpsLog:
    """Return the fixes of a bag.

    `rows`: time [s], longitude, latitude [deg], height [m] and standard deviation [m] of each fix, 0 where it
    states none.
    """
    if not rows:
        raise InputError(
            f"{place} holds {n_without_fix} NavSatFix messages and no fix among them; record again once there is one."
        )
    table = np.array(rows)
    sigma_m, notes = _stated_sigma_m(table[:, 4])
    log = GpsLog(table[:, 0], table[:, 1:4], True, True, n_without_fix, ELLIPSOIDAL, sigma_m, notes)
    return log.without_zero_places(str(place))


def _stated_sigma_m(sigma_m: FloatArray) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return standard deviations (N,) [m], the largest for fixes that state none, or None where most state none; and a note."""
    is_stated = sigma_m > 0.0
    n_stated, n = int(is_stated.sum()), len(sigma_m)
    if n_stated == n:
        return sigma_m, ()
    if n_stated <= _LEAST_STATED * n:
        note = f"{n_stated} of {n} fixes state a covariance, which is not used"
        return None, ((note,) if n_stated else ())
    largest_m = float(sigma_m[is_stated].max())
    return np.where(is_stated, sigma_m, largest_m), (
        f"{n - n_stated} of {n} fixes state no covariance and take the largest standard deviation of the others, {largest_m:.3g} m",
    )


# Share of messages that may be older than one before.
_MOST_LATE = 0.1


def in_order(time_s: Sequence[float]) -> BoolArray:
    """Return which messages are later than all before them; every one where more than a tenth goes back in time.

    Drivers publish the same reading twice, and networks deliver late messages. Times of a clock that was set back are
    left as they are: no message is in its place then.

    `time_s`: time stamps in the order of the recording [s]. Returns (N,) bool: which messages to use.

    >>> in_order([1.0, 2.0, 2.0, 3.0]).tolist()
    [True, True, False, True]
    >>> in_order([9.0, 1.0, 2.0]).tolist()
    [True, True, True]
    """
    times = np.asarray(time_s, dtype=np.float64)
    latest = np.maximum.accumulate(np.r_[-np.inf, times])[:-1]
    if np.count_nonzero(times < latest) > _MOST_LATE * len(times):
        return np.ones(len(times), dtype=np.bool_)
    later: BoolArray = times > latest
    return later
