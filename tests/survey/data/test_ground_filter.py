"""The filter of ground on a made slope with houses, trees and low outliers, whose ground is known."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from survey import SurfacePoints
from survey.core.errors import CapacityError
from survey.data.ground_filter import GroundSurface, spacing_m

SIDE_M = 60.0


def ground_m(x, y):
    return 400.0 + 0.5 * x + 2.0 * np.sin(y / 12.0)


def scene(seed=0, n=8000):
    """Return points (N, 3) [m] and which are ground: a hillside of 27 degrees, a house of 12 m, trees and two low outliers."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.0, SIDE_M, (2, n))
    height = rng.normal(0.0, 0.03, n)
    is_house = (np.abs(x - 30.0) < 6.0) & (np.abs(y - 30.0) < 6.0)
    is_tree = ~is_house & (rng.random(n) < 0.3)
    height[is_house] += 5.0
    height[is_tree] += rng.uniform(2.5, 15.0, int(is_tree.sum()))
    low = np.array([n // 80, n // 2])
    height[low] = -12.0
    is_ground = ~is_house & ~is_tree
    is_ground[low] = False
    return np.column_stack([x, y, ground_m(x, y) + height]), is_ground


def test_houses_trees_and_low_outliers_are_told_from_a_hillside() -> None:
    xyz, is_ground = scene()
    found = GroundSurface.through(xyz).is_ground(xyz)
    assert (found & ~is_ground).sum() <= 0.01 * (~is_ground).sum()
    assert (~found & is_ground).sum() <= 0.02 * is_ground.sum()


def test_the_surface_is_that_of_the_ground_under_a_house() -> None:
    surface = GroundSurface.through(scene()[0])
    place = np.array([[30.0, 30.0, ground_m(30.0, 30.0)]])
    assert surface.is_ground(place).all()
    assert not surface.is_ground(place + [0.0, 0.0, 5.0]).any()


def test_a_moved_cloud_has_the_same_ground() -> None:
    xyz, _ = scene()
    moved = xyz + [256.0, 512.0, 1024.0]
    same = GroundSurface.through(xyz).is_ground(xyz) == GroundSurface.through(moved).is_ground(moved)
    assert same.mean() > 0.999


def test_a_plane_of_45_degrees_loses_no_ground() -> None:
    x, y = np.random.default_rng(1).uniform(0.0, 50.0, (2, 5000))
    xyz = np.column_stack([x, y, x + 0.0 * y])
    assert GroundSurface.through(xyz).is_ground(xyz).mean() > 0.98


def test_a_single_row_of_cells_is_filtered() -> None:
    xyz = np.column_stack([np.linspace(0.0, 30.0, 100), np.zeros(100), np.zeros(100)])
    xyz[50, 2] = 4.0
    assert (~GroundSurface.through(xyz).is_ground(xyz)).nonzero()[0].tolist() == [50]


def test_points_over_too_many_cells_are_refused() -> None:
    xyz = np.random.default_rng(2).uniform(0.0, 1.0, (200, 3))
    xyz[0, :2] = 1e5
    with pytest.raises(CapacityError, match="the points spread over 100,000"):
        GroundSurface.through(xyz)


def test_spacing_counts_covered_ground_alone() -> None:
    far = np.array([[0.0, 0.0], [5.0, 5.0], [1000.0, 1000.0], [1005.0, 1005.0]])
    assert spacing_m(far) == pytest.approx(np.sqrt(50.0))


def unclassified(path: Path, xyz: np.ndarray, last: np.ndarray | bool = True) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    header.offsets = np.array([500_000.0, 6_700_000.0, 0.0])
    header.add_crs(CRS("EPSG:32608"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (xyz + [500_000.0, 6_700_000.0, 0.0]).T
    las.number_of_returns = np.full(len(xyz), 2, dtype=np.uint8)
    las.return_number = np.where(np.broadcast_to(last, len(xyz)), 2, 1).astype(np.uint8)
    las.write(str(path))
    return path


def test_a_file_without_classes_is_filtered_and_says_so(tmp_path: Path) -> None:
    xyz, is_ground = scene()
    last = is_ground | (np.arange(len(xyz)) % 2 == 0)
    points, (note,) = SurfacePoints.read_noted(unclassified(tmp_path / "a.las", xyz, last), sigma_m=0.1)
    assert abs(len(points) - is_ground.sum()) < 0.02 * is_ground.sum()
    assert "ground filtered (SMRF on cells of 1" in note
    assert f"{(~last).sum():,} earlier returns of a pulse" in note
    assert "off the ground" in note


def test_points_far_apart_are_all_used_and_a_note_says_so(tmp_path: Path) -> None:
    xyz = scene(n=100)[0]
    points, (note,) = SurfacePoints.read_noted(unclassified(tmp_path / "a.las", xyz, False), sigma_m=0.1)
    assert len(points) == 100
    assert "not filtered: they are 5.8 m apart" in note


def test_points_that_state_where_their_sensor_stood_are_not_filtered(tmp_path: Path) -> None:
    file = unclassified(tmp_path / "a.las", scene()[0])
    las = laspy.read(file)
    for name, axis in zip(("origin_x_m", "origin_y_m", "origin_z_m"), (las.x, las.y, las.z), strict=True):
        las.add_extra_dim(laspy.ExtraBytesParams(name=name, type=np.float64))
        las[name] = np.asarray(axis) + 2.0
    las.write(str(file))
    points, notes = SurfacePoints.read_noted(file, sigma_m=0.1)
    assert (len(points), notes) == (len(las.points), ())
