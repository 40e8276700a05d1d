"""ROS 1 and ROS 2 bags, read without ROS, and their point clouds (``sensor_msgs/msg/PointCloud2``)."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from survey.core import FloatArray, InputError, refusing_damage

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader


@contextmanager
def open_bag(place: Path, files: Sequence[Path] = ()) -> Iterator["AnyReader"]:
    """Open a bag; its messages are defined by itself or, where it has no definitions, as in the newest ROS."""
    require_rosbags(f"{place} is a bag, and reading it")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with (
        refusing_damage(str(place), "bag", "record or copy it again"),
        AnyReader(list(files) or [place], default_typestore=get_typestore(Stores.LATEST)) as reader,
    ):
        yield reader


def require_rosbags(what: str) -> None:
    """Refuse what needs rosbags where it is not installed; `what` begins the sentence."""
    try:
        import_module("rosbags.highlevel")
    except ImportError as error:
        raise InputError(f"{what} needs rosbags; install firnline[bags].") from error


_CLOUD = "sensor_msgs/msg/PointCloud2"


def bag_clouds(path: Path) -> Iterator[tuple[float, FloatArray]]:
    """Yield the clouds of a ROS 1 or ROS 2 recording.

    Yields `time_s`: time of the message [s]. `xyz` (N, 3): places in the sensor's frame [m]; points that say
    NaN met nothing and are left out.
    """
    place = path.parent if path.suffix in {".db3", ".mcap"} else path
    with open_bag(place) as reader:
        clouds = [connection for connection in reader.connections if connection.msgtype == _CLOUD]
        if not clouds:
            raise InputError(f"the recording {path} holds no {_CLOUD}; record the scanner's topic.")
        topics = sorted({connection.topic for connection in clouds})
        if len(topics) > 1:
            raise InputError(
                f"the recording {path} holds {len(topics)} topics of clouds ({', '.join(topics)}), each in a frame of its own; "
                "copy the topic of one scanner into a bag of its own (ros2 bag convert, rosbag filter)."
            )
        for connection, _, raw in reader.messages(connections=clouds):
            message: Any = reader.deserialize(raw, connection.msgtype)
            xyz = cloud_xyz(message, path)
            time_s = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            yield time_s, xyz[np.isfinite(xyz).all(axis=1)]


def cloud_xyz(message: Any, path: Path) -> FloatArray:
    """Return x, y and z (N, 3) [m] of a PointCloud2, from its fields' offsets."""
    kinds = {7: "f4", 8: "f8"}
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    for name in "xyz":
        if name not in fields or fields[name].datatype not in kinds:
            raise InputError(
                f"a cloud of {path} has no field {name!r} of floats; record PointCloud2 with x, y and z."
            )
    layout = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + kinds[fields[name].datatype] for name in "xyz"],
            "offsets": [fields[name].offset for name in "xyz"],
            "itemsize": message.point_step,
        }
    )
    points = np.frombuffer(bytes(message.data), dtype=layout, count=message.width * message.height)
    return np.column_stack([points[name].astype(np.float64) for name in "xyz"])
