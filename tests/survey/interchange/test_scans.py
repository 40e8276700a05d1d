"""Scans come in whole, with their sensor's place, or with one sentence."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints
from survey.interchange.bags import cloud_xyz
from survey.interchange.scans import SensorPath, read_scans, scan_files
from tests.survey.interchange.cloud_bags import write_cloud_bag

CRS = "EPSG:32608"
XYZ = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.5]])


def read(path: Path, **changes: object) -> SurfacePoints:
    settings: dict[str, object] = {"crs": CRS, "sigma_m": 0.03} | changes
    (scan,) = read_scans(scan_files([path]), **settings)  # type: ignore[arg-type]
    return scan


def test_an_npz_with_one_origin_or_one_per_point(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=XYZ, origin=[0.0, 0.0, 2.0])
    np.savez(tmp_path / "b.npz", points=XYZ, origins=XYZ + 1.0, sigma_m=0.5)
    first, second = read_scans(scan_files([tmp_path]), crs=CRS, sigma_m=0.03)
    assert first.origins is not None
    assert second.origins is not None
    np.testing.assert_array_equal(first.origins, np.tile([0.0, 0.0, 2.0], (3, 1)))
    np.testing.assert_array_equal(second.origins, XYZ + 1.0)
    assert second.sigma_z.tolist() == [0.5, 0.5, 0.5]


@pytest.mark.parametrize("ending", ["laz", "ply"])
def test_las_and_ply_carry_their_origins(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"scan.{ending}"
    SurfacePoints(XYZ, sigma_m=0.02, origins=XYZ + 2.0, crs=CRS).write(path)
    scan = read(path)
    # LAZ rounds to 0.1 mm.
    np.testing.assert_allclose(scan.xyz, XYZ, atol=1e-4)
    np.testing.assert_allclose(scan.origins, XYZ + 2.0, atol=1e-4)


def test_a_trajectory_gives_the_places_of_the_sensor(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    times = {"time_s": np.array([0.0, 0.5, 1.0])}
    SurfacePoints(XYZ, sigma_m=0.02, values=times, crs=CRS).write(path)
    track_file = tmp_path / "track.txt"
    track_file.write_text("0 0 0 2 0 0 0 1\n1 10 0 2 0 0 0 1\n", encoding="utf-8")
    scan = read(path, track=SensorPath.read(track_file))
    np.testing.assert_allclose(scan.origins, [[0, 0, 2], [5, 0, 2], [10, 0, 2]])
    late = tmp_path / "late.txt"
    late.write_text("5 0 0 2 0 0 0 1\n6 10 0 2 0 0 0 1\n", encoding="utf-8")
    with pytest.raises(InputError, match="same drive"):
        read(path, track=SensorPath.read(late))


def test_a_point_cloud_message_is_read_by_its_offsets() -> None:
    layout = np.dtype(
        {"names": ["x", "y", "z"], "formats": ["<f4"] * 3, "offsets": [0, 4, 8], "itemsize": 16}
    )
    data = np.zeros(3, dtype=layout)
    for k, name in enumerate("xyz"):
        data[name] = XYZ[:, k]
    fields = [SimpleNamespace(name=n, offset=4 * k, datatype=7) for k, n in enumerate("xyz")]
    message = SimpleNamespace(
        fields=fields,
        is_bigendian=False,
        point_step=16,
        width=3,
        height=1,
        data=np.frombuffer(data.tobytes(), np.uint8),
    )
    np.testing.assert_array_equal(cloud_xyz(message, Path("bag")), XYZ)
    message.fields = fields[:2]
    with pytest.raises(InputError, match="no field 'z'"):
        cloud_xyz(message, Path("bag"))


def test_a_ros_2_recording_is_turned_into_the_world(tmp_path: Path) -> None:
    write_cloud_bag(tmp_path / "bag", {1: np.vstack([XYZ, [[np.nan] * 3]])})
    (tmp_path / "track.txt").write_text(
        "0 100 0 2 0 0 0.7071067811865476 0.7071067811865476\n2 100 0 2 0 0 0.7071067811865476 0.7071067811865476\n",
        encoding="utf-8",
    )
    (file,) = scan_files([tmp_path / "bag"])
    with pytest.raises(InputError, match="--trajectory"):
        next(read_scans([file], crs=CRS, sigma_m=0.03))
    scan = next(read_scans([file], crs=CRS, sigma_m=0.03, track=SensorPath.read(tmp_path / "track.txt")))
    # A quarter turn to the left, then 100 m east and 2 m up; the point that met nothing is left out.
    expected = np.column_stack([100.0 - XYZ[:, 1], XYZ[:, 0], XYZ[:, 2] + 2.0])
    np.testing.assert_allclose(scan.xyz, expected, atol=1e-5)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"cloud": XYZ}, "`points` was expected"),
        ({"points": np.zeros((0, 3))}, "no surface points"),
        ({"points": [[np.nan, 0.0, 0.0]]}, "NaN"),
        ({"points": XYZ[:, :2]}, "shape"),
    ],
)
def test_bad_scans_get_one_sentence(tmp_path: Path, arrays: dict[str, object], words: str) -> None:
    np.savez(tmp_path / "bad.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=words):
        read(tmp_path / "bad.npz")


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=XYZ)
    with pytest.raises(InputError, match="--sigma"):
        read(tmp_path / "a.npz", sigma_m=None)
    with pytest.raises(InputError, match="--crs"):
        read(tmp_path / "a.npz", crs=None)
    (tmp_path / "b.npz").write_bytes(b"zip?")
    with pytest.raises(InputError, match="damaged"):
        read(tmp_path / "b.npz")
    with pytest.raises(InputError, match="is no scan"):
        scan_files([tmp_path / "c.txt"])
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="there is no scan"):
        scan_files([empty])


def test_scans_above_different_datums_are_refused(tmp_path: Path) -> None:
    for name, datum in (("a.ply", "EGM96 height"), ("b.ply", "ellipsoidal height")):
        points = SurfacePoints(XYZ, sigma_m=0.02, origins=XYZ + 2.0, crs=CRS, vertical_datum=datum)
        points.write(tmp_path / name)
    with pytest.raises(InputError, match="different vertical datums"):
        list(read_scans(scan_files([tmp_path]), crs=None, sigma_m=None))


def test_the_datum_of_a_named_crs_is_that_of_the_scan(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=XYZ, origin=[0.0, 0.0, 2.0])
    assert read(tmp_path / "a.npz", crs="EPSG:32608+5773").vertical_datum == "EGM96 height"
