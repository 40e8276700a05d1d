"""Usual names of standard deviations are understood in formats of a GIS too."""

from pathlib import Path

import pytest
import shapely

from survey.core.errors import InputError
from survey.io.named_points import read_named_points
from survey.io.points.formats import read_point_table


def marks(path: Path, **columns: list[float]) -> Path:
    geopandas = pytest.importorskip("geopandas")
    places = [shapely.Point(500_000.0, 6_700_000.0, 10.0), shapely.Point(500_100.0, 6_700_000.0, 11.0)]
    geopandas.GeoDataFrame(columns, geometry=places, crs="EPSG:32608").to_file(path)
    return path


@pytest.mark.parametrize("ending", ["gpkg", "geojson"])
def test_a_usual_name_of_the_standard_deviation_is_found(tmp_path: Path, ending: str) -> None:
    file = marks(tmp_path / f"marks.{ending}", sigma_z=[0.02, 0.03], snow_depth_m=[1.0, 2.0])
    table = read_point_table(file)
    assert table.columns["sigma_z_m"].tolist() == [0.02, 0.03]
    assert table.columns["snow_depth_m"].tolist() == [1.0, 2.0]


def test_a_mapping_of_columns_beside_a_file_without_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no text table, whose columns can be chosen"):
        read_named_points(
            marks(tmp_path / "m.gpkg", acc=[0.1, 0.2]), "the checkpoint file", {"sigma_z_m": "acc"}
        )
