"""Classes and flags of LAS: the ground is mapped, and noise and withheld points are not."""

import logging
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS

from survey import SurfacePoints
from survey.core.errors import InputError
from survey.interchange.conversion import convert
from survey.io.las import read_las
from survey.io.point_chunks import read_chunks
from survey.io.point_classes import WITHHELD
from survey.io.point_files import read_ply

N = 40
ODD = np.arange(N) % 2 == 1


def cloud(path: Path, classes: Any, withheld: Any = False) -> Path:
    """Write ground at 100 m, and what is none at 150 m."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    header.add_crs(CRS("EPSG:32608"))
    points = laspy.LasData(header)
    points.x, points.y, points.z = np.arange(float(N)), np.arange(float(N)), np.where(ODD, 150.0, 100.0)
    points.classification = np.broadcast_to(classes, N).astype(np.uint8)
    points.withheld = np.broadcast_to(withheld, N).astype(np.uint8)
    points.write(str(path))
    return path


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize(
    ("classes", "withheld"),
    [
        (np.where(ODD, 5, 2), False),
        (np.where(ODD, 7, 1), False),
        (np.where(ODD, 18, 0), False),
        (0, ODD),
        (2, ODD),
    ],
)
def test_ground_alone_becomes_surface_points(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, ending: str, classes: Any, withheld: Any
) -> None:
    file = cloud(tmp_path / f"a.{ending}", classes, withheld)
    with caplog.at_level(logging.WARNING):
        points = SurfacePoints.read(file, sigma_m=0.1)
    assert points.xyz[:, 2].tolist() == [100.0] * (N // 2)
    assert f"{N // 2} of {N} points are used" in caplog.text


@pytest.mark.parametrize(
    ("code", "ground", "n"),
    [(0, "auto", N // 2), (1, "auto", N // 2), (2, "auto", N), (2, "classified", N)]
    + [(0, "all", N), (2, "all", N), (5, "all", N), (1, None, N)],
)
def test_points_of_one_class_are_all_read_where_it_is_ground_or_all_are_wanted(
    tmp_path: Path, code: int, ground: Any, n: int
) -> None:
    assert len(SurfacePoints.read(cloud(tmp_path / "a.las", code), sigma_m=0.1, ground=ground)) == n


def test_classified_ground_is_asked_for_and_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.las holds no point that is classified as ground"):
        SurfacePoints.read(cloud(tmp_path / "a.las", 1), sigma_m=0.1, ground="classified")


def test_classified_ground_of_a_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x_m,y_m,z_m\n0,0,1\n1,0,1\n0,1,1\n")
    with pytest.raises(InputError, match="states no classes of points"):
        SurfacePoints.read(tmp_path / "a.csv", crs="EPSG:32608", sigma_m=0.1, ground="classified")


def test_points_that_are_left_out_are_counted_by_reason(tmp_path: Path) -> None:
    classes = np.where(ODD, 1, 2)
    classes[:5] = (7, 18, 12, 8, 6)
    file = cloud(tmp_path / "a.las", classes)
    las = laspy.read(file)
    las.synthetic = np.arange(N) == 6
    las.withheld = np.arange(N) == 8
    las.write(str(file))
    points, notes = SurfacePoints.read_noted(file, sigma_m=0.1)
    assert len(points) == 16
    (note,) = notes
    assert "16 of 40 points are used, ground by class; left out: " in note
    for part in ("19 of other classes", "2 noise", "1 overlap", "1 withheld", "1 synthetic"):
        assert part in note


def test_a_flag_of_all_points_leaves_none_out(tmp_path: Path) -> None:
    file = cloud(tmp_path / "a.las", 2)
    las = laspy.read(file)
    las.synthetic = np.ones(N, dtype=np.uint8)
    las.write(str(file))
    assert len(SurfacePoints.read(file, sigma_m=0.1)) == N


def test_noise_alone_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.las holds noise and withheld points alone"):
        SurfacePoints.read(cloud(tmp_path / "a.las", 7), sigma_m=0.1)


def test_a_conversion_keeps_every_point(tmp_path: Path) -> None:
    convert(cloud(tmp_path / "a.las", np.where(ODD, 7, 2)), tmp_path / "a.csv", "points")
    assert len((tmp_path / "a.csv").read_text().splitlines()) == N + 1


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_withheld_points_are_marked_in_chunks(tmp_path: Path, ending: str) -> None:
    (chunk,) = read_chunks(cloud(tmp_path / f"a.{ending}", 2, ODD), 0, N)
    assert chunk.classes.tolist() == np.where(ODD, WITHHELD, 2).tolist()


def test_coordinates_that_32_bits_round_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 1\n"
    for kind, is_named in (("float", True), ("double", False)):
        caplog.clear()
        properties = "".join(f"property {kind} {axis}\n" for axis in "xyz")
        (tmp_path / "a.ply").write_text(f"{head}{properties}end_header\n500000.3 6700000.3 800.1\n")
        read_ply(tmp_path / "a.ply")
        assert ("rounds them to 0.5 m" in caplog.text) is is_named


@pytest.mark.parametrize(("step", "is_named"), [(1.0, True), (0.1, True), (0.01, False), (0.001, False)])
def test_coarse_steps_of_heights_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, step: float, is_named: bool
) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, step)
    points = laspy.LasData(header)
    points.x, points.y, points.z = np.arange(3.0), np.arange(3.0), np.full(3, 800.0)
    points.write(str(tmp_path / "a.las"))
    read_las(tmp_path / "a.las")
    assert (f"stores heights in steps of {step:g}" in caplog.text) is is_named
