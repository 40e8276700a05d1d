"""Points state how much they err, in files as in memory."""

from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints

CRS = "EPSG:32608"
PLACES = np.arange(12.0).reshape(4, 3)


def test_sigma_and_covariance_agree_about_the_height() -> None:
    covariance = np.tile(np.diag([1.0, 2.0, 0.25]), (4, 1, 1))
    np.testing.assert_array_equal(SurfacePoints(PLACES, covariance=covariance, crs=CRS).sigma_z, 0.5)
    np.testing.assert_array_equal(SurfacePoints(PLACES, sigma_m=0.5, crs=CRS).sigma_z, 0.5)


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"sigma_m": 0.0}, "variance of 0 or less"),
        ({"sigma_m": -0.1}, "variance of 0 or less"),
        ({"sigma_m": np.nan}, "NaN"),
        ({}, "either"),
        ({"sigma_m": 0.1, "covariance": np.tile(np.eye(3), (4, 1, 1))}, "not both"),
        ({"covariance": np.tile(np.diag([-1.0, 1.0, 1.0]), (4, 1, 1))}, "negative"),
        ({"covariance": np.tile(np.diag([1.0, 1.0, 0.0]), (4, 1, 1))}, "variance of 0 or less"),
        ({"sigma_m": 0.1, "values": {"temperature_c": np.ones(3)}}, "temperature_c"),
    ],
)
def test_wrong_uncertainties_are_refused(settings: dict[str, object], word: str) -> None:
    with pytest.raises(InputError, match=word):
        SurfacePoints(PLACES, **settings, crs=CRS)


def test_nan_places_are_refused() -> None:
    with pytest.raises(InputError, match="NaN"):
        SurfacePoints([[0.0, np.nan, 1.0]], sigma_m=0.1, crs=CRS)


def test_selection_keeps_every_column() -> None:
    points = SurfacePoints(
        PLACES,
        sigma_m=0.1,
        range_m=np.arange(4.0),
        values={"humidity_percent": np.arange(4.0)},
        crs=CRS,
        vertical_datum="EGM96 height",
    )
    two = points.select(np.array([True, False, True, False]))
    assert len(two) == 2
    assert two.range_m is not None
    np.testing.assert_array_equal(two.range_m, [0.0, 2.0])
    np.testing.assert_array_equal(two.values["humidity_percent"], [0.0, 2.0])
    assert two.vertical_datum == "EGM96 height"


def _table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "points.csv"
    path.write_text(text)
    return path


def test_a_file_without_uncertainty_needs_one_named(tmp_path: Path) -> None:
    path = _table(tmp_path, "x_m,y_m,z_m\n0,0,5\n1,0,6\n")
    with pytest.raises(InputError, match="sigma_z_m"):
        SurfacePoints.read(path, crs=CRS)
    np.testing.assert_array_equal(SurfacePoints.read(path, crs=CRS, sigma_m=0.2).sigma_z, 0.2)


def test_half_a_covariance_is_refused(tmp_path: Path) -> None:
    path = _table(tmp_path, "x_m,y_m,z_m,cov_xx_m2,cov_zz_m2\n0,0,5,1,1\n")
    with pytest.raises(InputError, match="cov_xy_m2"):
        SurfacePoints.read(path, crs=CRS)


def test_a_csv_file_needs_its_crs_named_and_degrees_are_refused(tmp_path: Path) -> None:
    path = _table(tmp_path, "x_m,y_m,z_m,sigma_z_m\n0,0,5,0.1\n")
    with pytest.raises(InputError, match="no coordinate reference system"):
        SurfacePoints.read(path)
    with pytest.raises(InputError, match="degree"):
        SurfacePoints.read(path, crs="EPSG:4326")


def test_a_file_in_another_crs_than_named_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.ply"
    SurfacePoints(PLACES, sigma_m=0.1, crs=CRS).write(path)
    with pytest.raises(InputError, match="different systems"):
        SurfacePoints.read(path, crs="EPSG:32609")


def test_a_zero_sigma_in_a_file_names_the_file(tmp_path: Path) -> None:
    path = _table(tmp_path, "x_m,y_m,z_m,sigma_z_m\n0,0,5,0\n")
    with pytest.raises(InputError, match=r"points\.csv.*variance of 0 or less"):
        SurfacePoints.read(path, crs=CRS)


def test_points_that_a_file_repeats_count_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rows = [
        "x_m,y_m,z_m,sigma_z_m",
        "500000,6000000,10,0.2",
        "500001,6000000,11,0.2",
        "500000,6000000,10,0.2",
    ]
    (tmp_path / "twice.csv").write_text("\n".join([*rows, "500001,6000000,11.5,0.2"]) + "\n")
    points = SurfacePoints.read(tmp_path / "twice.csv", crs="EPSG:32608")
    assert points.z.tolist() == [10.0, 11.0, 11.5]  # A place that was measured again is kept.
    assert "1 of 4 points repeat another one exactly" in caplog.text
