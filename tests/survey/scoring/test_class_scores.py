"""Errors are summarised by class of slope and of land cover."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from pyproj import CRS

from survey import InputError
from survey.io.vector import write_features
from survey.scoring.class_scores import class_scores, land_cover_at, slope_classes

UTM = CRS("EPSG:32608")
PLACES = np.array([[500_005.0, 6_700_005.0], [500_015.0, 6_700_005.0], [500_095.0, 6_700_005.0]])


def test_each_class_has_its_own_statistics() -> None:
    errors = np.r_[np.full(4, 0.1), np.full(2, -0.3)]
    ice, rock = class_scores(errors, np.r_[np.full(4, 0.1), 0.1, 0.2], ["ice"] * 4 + ["rock"] * 2)
    assert (ice.name, ice.n, ice.bias_m, ice.coverage_95) == ("ice", 4, pytest.approx(0.1), 1.0)
    assert (rock.rmse_m, rock.nmad_m, rock.coverage_95) == (pytest.approx(0.3), 0.0, 0.5)
    with pytest.raises(InputError, match="1 classes"):
        class_scores(errors, errors, ["ice"])


def test_slopes_fall_into_classes_in_ascending_order() -> None:
    names = slope_classes(np.array([35.0, 2.0, 12.0, np.nan]))
    rows = class_scores(np.zeros(4), np.ones(4), names)
    assert [row.name for row in rows] == ["0 to 5°", "10 to 20°", "30 to 90°", "no class"]


def write_codes(path: Path, values: np.ndarray, crs: str = "EPSG:32608", nodata: int | None = 0) -> Path:
    profile = {
        "driver": "GTiff", "width": values.shape[1], "height": values.shape[0], "count": 1, "dtype": values.dtype,
        "crs": crs, "transform": Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 6_700_010.0), "nodata": nodata,
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as target:
        target.write(values, 1)
    return path


def test_codes_of_a_raster_are_read_at_places_without_interpolation(tmp_path: Path) -> None:
    path = write_codes(tmp_path / "cover.tif", np.array([[3, 0]], dtype=np.uint8))
    assert land_cover_at(path, PLACES, UTM).tolist() == ["3", "no class", "no class"]
    decimals = write_codes(tmp_path / "z.tif", np.ones((1, 2), dtype=np.float32))
    with pytest.raises(InputError, match="holds whole numbers"):
        land_cover_at(decimals, PLACES, UTM)


def test_classes_of_polygons_are_read_by_their_column_in_another_crs(tmp_path: Path) -> None:
    boxes = [
        shapely.box(500_000, 6_700_000, 500_010, 6_700_010),
        shapely.box(500_000, 6_700_000, 500_020, 6_700_010),
    ]
    columns = {"class": np.array(["ice", "rock"], dtype=object), "owner": np.array(["a", "b"], dtype=object)}
    write_features(tmp_path / "cover.gpkg", boxes, columns, UTM, layer="cover")
    assert land_cover_at(tmp_path / "cover.gpkg", PLACES, UTM).tolist() == ["ice", "rock", "no class"]
    assert land_cover_at(tmp_path / "cover.gpkg", PLACES, UTM, "owner").tolist() == ["a", "b", "no class"]
    write_features(tmp_path / "cover.geojson", boxes, columns, UTM, layer="cover")
    assert land_cover_at(tmp_path / "cover.geojson", PLACES, UTM).tolist() == ["ice", "rock", "no class"]
    with pytest.raises(InputError, match="no column 'lc'"):
        land_cover_at(tmp_path / "cover.gpkg", PLACES, UTM, "lc")
    write_features(
        tmp_path / "odd.gpkg", boxes, {"a": columns["class"], "b": columns["owner"]}, UTM, layer="cover"
    )
    with pytest.raises(InputError, match="none is named class; choose one with --class-column"):
        land_cover_at(tmp_path / "odd.gpkg", PLACES, UTM)
