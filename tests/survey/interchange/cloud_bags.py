"""ROS 2 bags of point clouds for tests."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from survey.core.arrays import FloatArray


def write_cloud_bag(folder: Path, clouds: Mapping[int, FloatArray]) -> None:
    """Write clouds (N, 3), by the second of their time; skip the test where rosbags is not installed."""
    writer = pytest.importorskip("rosbags.rosbag2", reason="rosbags, the extra `ros`, is not installed")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    point_field = kinds["sensor_msgs/msg/PointField"]
    fields = [point_field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate("xyz")]
    with writer.Writer(folder, version=8) as bag:
        connection = bag.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=store)
        for second, xyz in clouds.items():
            time = kinds["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
            cloud = kinds["sensor_msgs/msg/PointCloud2"](
                header=kinds["std_msgs/msg/Header"](stamp=time, frame_id="lidar"),
                height=1,
                width=len(xyz),
                fields=fields,
                is_bigendian=False,
                point_step=12,
                row_step=12 * len(xyz),
                data=np.frombuffer(xyz.astype("<f4").tobytes(), np.uint8),
                is_dense=False,
            )
            bag.write(connection, 10**9 * second, store.serialize_cdr(cloud, "sensor_msgs/msg/PointCloud2"))
