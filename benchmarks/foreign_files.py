"""Readers of files that other programs wrote, for the fuzzing of real files: ``python -m benchmarks.fuzz_formats --real FOLDER``.

Files are taken from any folder: data that stand beside the project, tests of installed packages, unpacked source archives of
laspy, pyulog and others. None is copied into the project. `made` adds what is seldom at hand, written by the libraries of
others: NetCDF by xarray, Parquet by pyarrow, bags and MCAP by rosbags, FlatGeobuf and HGT by GDAL, YAML by OpenCV.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from live.autopilot_logs import read_autopilot_log
from live.mission_items import AutopilotMission
from survey import Camera, Dem, SurfacePoints
from survey.core.errors import FirnlineError
from survey.interchange.route_formats import read_plan
from survey.io.point_chunks import parquet_chunks, parquet_facts
from survey.io.vector import read_features
from vision_slam.readers.bags import read_bag
from vision_slam.readers.calibrations import read_calibration
from vision_slam.readers.gps_files import read_gps
from vision_slam.readers.photos import read_photo

UTM = "EPSG:32608"
LARGEST_BYTES = 3_000_000
_LENS = np.array([[20.0, 0, 3.5], [0, 20.0, 3.5], [0, 0, 1]])
_CAMERA = Camera("pinhole", 8, 8, _LENS, np.zeros(5), np.eye(4))


def _points(path: Path) -> Any:
    try:
        return SurfacePoints.read(path, sigma_m=0.1)
    except FirnlineError as refusal:
        if "--crs" not in str(refusal) and "crs" not in str(refusal):
            raise
        return SurfacePoints.read(path, crs=UTM, sigma_m=0.1)


def _parquet(path: Path) -> Any:
    n, *_ = parquet_facts(path)
    return list(parquet_chunks(path, 0, n, 10_000))


def _bag(path: Path) -> Any:
    sequence = read_bag(path, camera=_CAMERA)
    return [sequence.frames[k] for k in range(len(sequence.frames))]


def _plan(path: Path) -> Any:
    return read_plan(path), AutopilotMission.read(path)


READERS: dict[str, Callable[[Path], Any]] = {
    **dict.fromkeys((".las", ".laz", ".ply"), _points),
    **dict.fromkeys((".nc", ".hgt", ".tif", ".asc", ".vrt"), Dem.read),
    **dict.fromkeys((".shp", ".gpkg", ".fgb", ".kml", ".kmz", ".geojson"), read_features),
    **dict.fromkeys((".ulg", ".bin", ".tlog"), read_autopilot_log),
    **dict.fromkeys((".bag", ".mcap"), _bag),
    **dict.fromkeys((".gpx", ".ubx", ".nmea", ".pos"), read_gps),
    **dict.fromkeys((".yaml", ".yml"), read_calibration),
    **dict.fromkeys((".jpg", ".jpeg"), read_photo),
    ".parquet": _parquet,
    ".plan": _plan,
    ".waypoints": _plan,
}
"""By the suffix of a file."""


def real_files(folders: Iterable[Path]) -> list[Path]:
    """Return the files of some folders that a reader takes, small enough to be read many times."""
    found = (path for folder in folders for path in sorted(folder.rglob("*")))
    return [
        path
        for path in found
        if path.suffix.lower() in READERS and path.is_file() and 0 < path.stat().st_size <= LARGEST_BYTES
    ]


def made(folder: Path) -> None:
    """Write a file of each kind that is seldom at hand, by the libraries of others."""
    for write in (_netcdf, _parquet_file, _rasters_and_vectors, _bags, _calibration):
        write(folder)


def _netcdf(folder: Path) -> None:
    import xarray

    axis = np.arange(40.0)
    heights = xarray.DataArray(
        np.add.outer(axis, axis), {"y": 6.7e6 - 10.0 * axis, "x": 5e5 + 10.0 * axis}, name="z"
    )
    heights.to_netcdf(folder / "xarray.nc", engine="h5netcdf")


def _parquet_file(folder: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    rng = np.random.default_rng(1)
    parquet.write_table(pyarrow.table({name: rng.random(500) for name in "xyz"}), folder / "pyarrow.parquet")


def _rasters_and_vectors(folder: Path) -> None:
    import pyogrio
    import rasterio
    import shapely
    from rasterio.transform import from_origin

    step = 1.0 / 1200.0
    with rasterio.open(
        folder / "N58W135.hgt", "w", driver="SRTMHGT", width=1201, height=1201, count=1, dtype="int16",
        crs="EPSG:4326", transform=from_origin(-135.0 - 0.5 * step, 59.0 + 0.5 * step, step, step),
    ) as target:  # fmt: skip
        target.write(np.full((1, 1201, 1201), 700, np.int16))
    square = shapely.to_wkb(np.array([shapely.box(5e5, 6.7e6, 5e5 + 400.0, 6.7e6 + 300.0)]))
    pyogrio.raw.write(
        folder / "gdal.fgb", square, [np.array(["a"], dtype=object)], ["name"],
        geometry_type="Polygon", crs=UTM, driver="FlatGeobuf",
    )  # fmt: skip


def _bags(folder: Path) -> None:
    from rosbags.rosbag1 import Writer as FirstWriter
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as SecondWriter
    from rosbags.typesys import Stores, get_typestore

    for store, name in ((Stores.ROS1_NOETIC, "first.bag"), (Stores.ROS2_HUMBLE, "second")):
        types = get_typestore(store)
        kinds = types.types
        is_first = store is Stores.ROS1_NOETIC
        stamp = kinds["builtin_interfaces/msg/Time"]
        head = [0] if is_first else []
        writer = (
            FirstWriter(folder / name)
            if is_first
            else SecondWriter(folder / name, version=9, storage_plugin=StoragePlugin.MCAP)
        )
        with writer as bag:
            at = bag.add_connection("/camera/image_raw", "sensor_msgs/msg/Image", typestore=types)
            for k in range(3):
                header = kinds["std_msgs/msg/Header"](*head, stamp(k + 1, 0), "camera")
                message = kinds["sensor_msgs/msg/Image"](
                    header, 8, 8, "mono8", 0, 8, np.full(64, 9 * k, np.uint8)
                )
                pack = types.serialize_ros1 if is_first else types.serialize_cdr
                bag.write(at, (k + 1) * 10**9, pack(message, "sensor_msgs/msg/Image"))
    next((folder / "second").glob("*.mcap")).replace(folder / "rosbags.mcap")


def _calibration(folder: Path) -> None:
    import cv2

    file = cv2.FileStorage(str(folder / "opencv.yaml"), cv2.FILE_STORAGE_WRITE)
    file.write("image_width", 320)
    file.write("image_height", 240)
    file.write("camera_matrix", np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]]))
    file.write("distortion_coefficients", np.zeros((1, 5)))
    file.release()
