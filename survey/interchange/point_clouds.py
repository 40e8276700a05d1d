"""Read point clouds of ROS 1 and ROS 2 recordings (``sensor_msgs/msg/PointCloud2``)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.interchange.bags import opened_bag

_CLOUD = "sensor_msgs/msg/PointCloud2"


def bag_clouds(path: Path) -> Iterator[tuple[float, FloatArray]]:
    """Yield the clouds of a ROS 1 or ROS 2 recording.

    Parameters
    ----------
    path : pathlib.Path
        A ``.bag`` of ROS 1; or the folder of a ROS 2 recording, or the ``.db3`` or ``.mcap`` file in it.

    Yields
    ------
    time_s : float
        Time of the message [s].
    xyz : (N, 3) ndarray
        Places in the sensor's frame [m]; points that say NaN met nothing and are left out.

    Raises
    ------
    InputError
        The recording is damaged, holds no cloud or several topics of them, or rosbags is not installed.
    """
    place = path.parent if path.suffix in {".db3", ".mcap"} else path
    with opened_bag(place) as reader:
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
    """Return x, y and z (N, 3) [m] of a PointCloud2, from its fields' offsets.

    Raises
    ------
    InputError
        A field is missing or no 32- or 64-bit float.
    """
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
