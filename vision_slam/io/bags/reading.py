"""ROS 1 and ROS 2 bags, read without ROS: images, calibration, fixes, inertial readings, odometry."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames, Image
from survey.data.sensors.aiding import Inertial
from survey.interchange.bags import opened_bag
from vision_slam.io.bags.fixes import bag_fixes
from vision_slam.io.bags.message_order import in_order
from vision_slam.io.bags.messages import (
    COMPRESSED,
    IMAGE,
    decode_camera,
    decode_fix_sigma_m,
    decode_pixels,
    decode_transform,
    decode_wheels,
    stamp_s,
)
from vision_slam.io.images import bits_used, eight_bits, scaling_note
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.sequence_files import FORWARD

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

_KINDS = {
    "images": (IMAGE, COMPRESSED),
    "calibration": ("sensor_msgs/msg/CameraInfo",),
    "fixes": ("sensor_msgs/msg/NavSatFix",),
    "inertial": ("sensor_msgs/msg/Imu",),
    "odometry": ("nav_msgs/msg/Odometry",),
}
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_SAMPLED_EVERY = 10  # images that are checked for size and depth before any is used
_BASES = ("base_footprint", "base_link")


def is_bag(path: Path) -> bool:
    """Return whether a path is a ROS 1 bag, a folder of one split into files, or a ROS 2 bag's folder or file.

    Examples
    --------
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


def read_bag(path: str | Path, topics: Sequence[str] = (), camera: Camera | None = None) -> ImageSequence:
    """Read a bag; topics are recognized by their type.

    Images are raw or compressed (`sensor_msgs`) and are decoded when they are used;
    calibration, fixes, inertial readings and odometry are read at once. Fixes most of which state a
    covariance have its horizontal standard deviation, and those without one the largest, with a note. Poses of an odometry
    count as wheels: only the distance between them is used. Where ``/tf_static`` has the
    mounting of camera and inertial unit on ``base_link``, both are rotated into the body frame;
    else the camera is assumed level and forward, and the inertial unit aligned with the body,
    and a note is added. Messages that repeat a time or come late are left out, with a note.

    Parameters
    ----------
    path : str or pathlib.Path
        A ``.bag`` file, the folder of one that rosbag split (``…_0.bag``, ``…_1.bag``, …), the folder of a ROS 2 bag, or one
        of its files, which is read alone where ``metadata.yaml`` is not beside it.
    topics : sequence of str
        Which topics to take, for those kinds of which the bag has several.
    camera : Camera, optional
        Calibration and mounting to use instead of those of the bag.

    Returns
    -------
    ImageSequence
        Images, fixes and what else the bag has.

    Raises
    ------
    InputError
        rosbags is not installed, the bag is damaged, has no images or no calibration, or
        several topics of one kind of which none is named.
    """
    place = Path(path)
    has_folder = place.suffix in {".mcap", ".db3"} and (place.parent / "metadata.yaml").is_file()
    place = place.parent if has_folder else place
    with opened_bag(place, _split_files(place)) as reader:
        taken = _taken(reader.connections, topics, place)
        if "images" not in taken:
            raise InputError(
                f"{place} holds no images (sensor_msgs Image or CompressedImage); name another bag."
            )
        found = _everything(reader, taken)
    return _sequence(place, taken, found, camera)


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


def _taken(connections: Sequence[Any], topics: Sequence[str], place: Path) -> dict[str, str]:
    """Choose one topic for each kind of record."""
    unknown = [topic for topic in topics if topic not in {connection.topic for connection in connections}]
    if unknown:
        have = ", ".join(sorted({connection.topic for connection in connections}))
        raise InputError(f"{place} has no topic {unknown[0]} (it has {have}); correct --topic.")
    taken: dict[str, str] = {}
    for kind, types in _KINDS.items():
        fitting = {connection.topic for connection in connections if connection.msgtype in types}
        named = fitting.intersection(topics) or fitting
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


def _everything(reader: "AnyReader", taken: dict[str, str]) -> _Found:
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
    _note_left_out(notes, taken["images"], stays)
    return np.flatnonzero(stays)


def _note_left_out(notes: list[str], topic: str, stays: BoolArray) -> None:
    if not stays.all():
        notes.append(
            f"{int((~stays).sum())} messages of {topic} repeat a time or come late, and are left out"
        )


def _sequence(place: Path, taken: dict[str, str], found: _Found, camera: Camera | None) -> ImageSequence:
    notes = [f"{kind} from {topic}" for kind, topic in taken.items()]
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
    return ImageSequence(
        camera,
        Frames(np.array(found.stamps)[numbers], _BagImages(place, taken["images"], found.shift, numbers)),
        wheels=decode_wheels(found.odometry) if found.odometry else None,
        inertial=inertial,
        gps=gps,
        notes=tuple(notes),
    )


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
        with opened_bag(self._place, _split_files(self._place)) as reader:
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
