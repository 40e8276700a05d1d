"""Point files come back as they went, and say what is wrong with them."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely

from survey.core.errors import CapacityError, InputError
from survey.data.surface_points import SurfacePoints
from survey.io import point_table
from survey.io.point_files import read_point_table
from survey.io.vector import write_features

FORMATS = [".csv", ".gpkg", ".geojson", ".las", ".laz", ".ply"]
CRS = "EPSG:32608"


@pytest.fixture
def points() -> SurfacePoints:
    rng = np.random.default_rng(5)
    n = 7
    root = rng.standard_normal((n, 3, 3))
    return SurfacePoints(
        np.column_stack([500_000 + 9 * rng.random(n), 6_500_000 + 9 * rng.random(n), rng.random(n)]),
        covariance=root @ root.transpose(0, 2, 1) + np.eye(3),
        origins=rng.random((n, 3)),
        range_m=rng.random(n),
        values={"temperature_c": rng.random(n)},
        value_sigmas={"temperature_c": 0.1 + rng.random(n)},
        crs=CRS,
        vertical_datum="EGM2008 height",
    )


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_column_comes_back(points: SurfacePoints, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"points{suffix}"
    points.write(path)
    stated = {"crs": CRS, "vertical_datum": "EGM2008 height"} if suffix == ".csv" else {}
    back = SurfacePoints.read(path, **stated)
    # LAS keeps tenths of a millimetre; GeoJSON is written with 7 decimals; the others are exact.
    step = {".las": 5.1e-5, ".laz": 5.1e-5, ".geojson": 1e-7}.get(suffix, 0.0)
    np.testing.assert_allclose(back.xyz, points.xyz, rtol=0, atol=step)
    for name in ("covariance", "origins", "range_m"):
        np.testing.assert_allclose(getattr(back, name), getattr(points, name), rtol=1e-12)
    np.testing.assert_allclose(back.values["temperature_c"], points.values["temperature_c"], rtol=1e-12)
    np.testing.assert_allclose(back.value_sigmas["temperature_c"], points.value_sigmas["temperature_c"])
    assert back.crs.equals(points.crs, ignore_axis_order=True)
    assert back.vertical_datum == points.vertical_datum


@pytest.mark.parametrize("suffix", FORMATS)
def test_equal_points_give_equal_bytes(points: SurfacePoints, suffix: str, tmp_path: Path) -> None:
    one, two = tmp_path / f"one{suffix}", tmp_path / "other"
    two.mkdir()
    points.write(one)
    points.write(two / one.name)
    assert one.read_bytes() == (two / one.name).read_bytes()


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("damage", ["missing", "empty", "garbage", "cut"])
def test_damaged_files_are_named_in_one_sentence(
    points: SurfacePoints, suffix: str, damage: str, tmp_path: Path
) -> None:
    path = tmp_path / f"damaged{suffix}"
    points.write(path)
    whole = path.read_bytes()
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(
            {"empty": b"", "garbage": b"\x07no points\xff" * 9, "cut": whole[: len(whole) // 2]}[damage]
        )
    with pytest.raises(InputError) as refusal:
        SurfacePoints.read(path, crs=CRS)
    message = str(refusal.value)
    assert path.name in message
    assert "\n" not in message


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("x_m,w,z_m,sigma_z_m\n1,2,3,0.1\n")
    with pytest.raises(InputError, match="y_m"):
        SurfacePoints.read(path, crs=CRS)


def test_an_unknown_ending_names_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.csv, \.fgb, .*\.txt, \.xyz was expected"):
        SurfacePoints.read(tmp_path / "points.dat", crs=CRS)


def test_a_column_that_contradicts_the_coordinates_is_refused(tmp_path: Path) -> None:
    shapes = shapely.points([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    for z, words in ((np.array([3.0, 6.0]), None), (np.array([0.0, 6.0]), "column z_m that differs")):
        write_features(tmp_path / "a.gpkg", shapes, {"z_m": z}, pyproj.CRS(CRS), layer="a")
        if words is None:
            assert read_point_table(tmp_path / "a.gpkg").columns["z_m"].tolist() == [3.0, 6.0]
        else:
            with pytest.raises(InputError, match=words):
                read_point_table(tmp_path / "a.gpkg")


def test_more_points_than_fit_the_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = SurfacePoints(np.arange(9.0).reshape(3, 3), sigma_m=0.1, crs="EPSG:32608")
    monkeypatch.setattr(point_table, "LARGEST_POINTS", 2)
    for ending in ("las", "laz", "ply"):
        points.write(tmp_path / f"a.{ending}")
        with pytest.raises(CapacityError, match="3 points; 2 can be read"):
            read_point_table(tmp_path / f"a.{ending}")


@pytest.mark.parametrize("heights", [(500_000.0, 500_001.0), (812_125.0, 812_130.0), (-13_000.0, -12_999.0)])
def test_heights_beyond_all_ground_are_refused(tmp_path: Path, heights: tuple[float, float]) -> None:
    rows = "".join(f"1,{k},{height},0.1\n" for k, height in enumerate(heights))
    (tmp_path / "p.csv").write_text("x_m,y_m,z_m,sigma_z_m\n" + rows)
    with pytest.raises(
        InputError, match=r"beyond all ground on Earth; choose the column of heights with --columns"
    ):
        read_point_table(tmp_path / "p.csv")


@pytest.mark.parametrize("mark", [-9999, -32768, 9999, 65535])
def test_a_height_that_stands_for_a_missing_one_is_refused(tmp_path: Path, mark: float) -> None:
    (tmp_path / "p.csv").write_text(f"x_m,y_m,z_m,sigma_z_m\n1,2,3,0.1\n4,5,{mark},0.1\n7,8,9,0.1\n")
    with pytest.raises(
        InputError, match=f"holds {mark} in z_m, first at point 2, which stands for a missing number"
    ):
        SurfacePoints.read(tmp_path / "p.csv", crs=CRS)


def test_a_place_may_have_a_number_that_is_no_height(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("x_m,y_m,z_m,sigma_z_m\n9999,-9999,3,0.1\n4,5,6,0.1\n7,8,9,0.1\n")
    assert len(SurfacePoints.read(tmp_path / "p.csv", crs=CRS)) == 3
