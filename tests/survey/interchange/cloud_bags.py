"""Bags of point clouds for tests."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from survey.core.arrays import FloatArray

_CLOUD = "sensor_msgs/msg/PointCloud2"


def write_cloud_bag(
    folder: Path, clouds: Mapping[int, FloatArray], topics: Sequence[str] = ("/points",)
) -> None:
    """Write clouds (N, 3), by the second of their time, in ROS 1 where the name ends in ``.bag``.

    Skip the test where rosbags is not installed.
    """
    is_first = folder.suffix == ".bag"
    module = "rosbags.rosbag1" if is_first else "rosbags.rosbag2"
    writer = pytest.importorskip(module, reason="rosbags, the extra `bags`, is not installed")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    kinds = store.types
    point_field = kinds["sensor_msgs/msg/PointField"]
    fields = [point_field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate("xyz")]
    to_bytes = store.serialize_ros1 if is_first else store.serialize_cdr
    counted = {"seq": 0} if is_first else {}
    with writer.Writer(folder) if is_first else writer.Writer(folder, version=8) as bag:
        connections = [bag.add_connection(name, _CLOUD, typestore=store) for name in topics]
        for second, xyz in clouds.items():
            time = kinds["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
            cloud = kinds[_CLOUD](
                header=kinds["std_msgs/msg/Header"](stamp=time, frame_id="lidar", **counted),
                height=1,
                width=len(xyz),
                fields=fields,
                is_bigendian=False,
                point_step=12,
                row_step=12 * len(xyz),
                data=np.frombuffer(xyz.astype("<f4").tobytes(), np.uint8),
                is_dense=False,
            )
            for connection in connections:
                bag.write(connection, 10**9 * second, to_bytes(cloud, _CLOUD))
