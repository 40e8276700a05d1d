"""Every reader of points and rasters gets a file with one element more than it understands, and uses, refuses or names it."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from pyproj import CRS

from survey.core import InputError
from survey.data import Dem, SurfacePoints
from survey.io.point_files import READ_ENDINGS
from survey.io.vector import write_features

UTM = CRS("EPSG:32608")
XYZ = np.array([[500001.5, 6700001.5, 300.0], [500002.5, 6700001.5, 310.0], [500001.5, 6700002.5, 320.0]])


def table(file: Path) -> str:
    """Write a text table with a column of texts."""
    mark = "\t" if file.suffix == ".tsv" else ","
    rows = [mark.join([*map(str, row), "0.1", "tree"]) for row in XYZ.tolist()]
    file.write_text("\n".join([mark.join(["x", "y", "z", "SDV", "Code"]), *rows, ""]))
    return "not used: Code"


def cloud_table(file: Path) -> str:
    """Write a cloud whose first column is a number of the point."""
    file.write_text("".join(f"{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate(XYZ.tolist())))
    return "--format pnezd"


def vector(file: Path) -> str:
    """Write points with a measured height in an attribute beside heights of 0."""
    flat = shapely.points(np.column_stack([XYZ[:, :2], np.zeros(3)]))
    if file.suffix in (".gpkg", ".geojson"):
        write_features(file, flat, {"elev": XYZ[:, 2]}, UTM, layer="p")
    else:
        import pyogrio

        driver = {".shp": "ESRI Shapefile", ".fgb": "FlatGeobuf", ".json": "GeoJSON"}[file.suffix]
        pyogrio.raw.write(
            file,
            shapely.to_wkb(flat),
            [XYZ[:, 2]],
            ["elev"],
            geometry_type="Point Z",
            crs=UTM.to_wkt(),
            driver=driver,
        )
    return "attribute elev"


def las(file: Path) -> str:
    """Write heights in feet by a GeoKey."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), XYZ[0]
    keys = laspy.vlrs.known.GeoKeyDirectoryVlr()
    for key, value in ((3072, 32608), (4096, 6360)):
        keys.geo_keys.append(laspy.vlrs.known.GeoKeyEntryStruct(key, 0, 1, value))
    keys.geo_keys_header.number_of_keys = 2
    header.vlrs.append(keys)
    data = laspy.LasData(header)
    data.x, data.y, data.z = XYZ.T
    data.write(str(file))
    return "US survey feet"


def ply(file: Path) -> str:
    """Write a cloud with a precision in millimetres."""
    head = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n"
    )
    head += "property double vertical_precision_mm\nend_header\n"
    file.write_text(head + "".join(f"{x} {y} {z} 50\n" for x, y, z in XYZ.tolist()))
    return "vertical_precision_mm"


POINTS: dict[str, Callable[[Path], str]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv"), table),
    ".xyz": cloud_table,
    **dict.fromkeys((".gpkg", ".geojson", ".json", ".shp", ".fgb"), vector),
    **dict.fromkeys((".las", ".laz"), las),
    ".ply": ply,
}


def test_every_reader_of_points_is_in_the_table() -> None:
    assert set(POINTS) == set(READ_ENDINGS)


@pytest.mark.parametrize("ending", POINTS)
def test_readers_of_points_count_what_they_leave_out(tmp_path: Path, ending: str, caplog: Any) -> None:
    word = POINTS[ending](tmp_path / f"a{ending}")
    crs = None if ending in (".las", ".laz") else "EPSG:32608"
    with caplog.at_level(logging.WARNING):
        try:
            SurfacePoints.read(tmp_path / f"a{ending}", crs=crs, sigma_m=0.1)
            said = caplog.text
        except InputError as error:
            said = str(error)
    assert word in said


RASTERS: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("an unknown unit", {}, {"units": ("furlong",)}, "counts in 'furlong'"),
    ("a unit of feet", {}, {"units": ("ft",)}, "heights in feet"),
    ("a vertical system in feet", {"crs": "EPSG:32608+6360"}, {}, "heights in US survey feet"),
    ("a system in feet", {"crs": "EPSG:2263"}, {}, "--units"),
    ("depths", {}, {"tags": {"positive": "down"}}, "counts downwards"),
    ("a mark that is not declared", {"mark": -9999.0}, {}, "not declared as nodata"),
    ("a unit beside another system", {"crs": "EPSG:32608+6360"}, {"units": ("m",)}, "correct one of them"),
]


@pytest.mark.parametrize(("name", "made", "also", "word"), RASTERS)
def test_readers_of_rasters_use_refuse_or_name_it(
    tmp_path: Path, name: str, made: dict[str, Any], also: dict[str, Any], word: str, caplog: Any
) -> None:
    del name
    place = Affine(10.0, 0.0, 5e5, 0.0, -10.0, 6.7e6)
    profile = {"height": 5, "width": 5, "count": 1, "dtype": "float32", "driver": "GTiff", "transform": place}
    values = np.arange(300.0, 325.0).reshape(5, 5)
    values[0, 0] = made.get("mark", values[0, 0])
    with rasterio.open(tmp_path / "a.tif", "w", crs=made.get("crs", "EPSG:32608"), **profile) as target:
        target.write(values.astype("f4"), 1)
        target.units = also.get("units", target.units)
        target.update_tags(1, **also.get("tags", {}))
    with caplog.at_level(logging.WARNING):
        try:
            Dem.read(tmp_path / "a.tif")
            said = caplog.text
        except InputError as error:
            said = str(error)
    assert word in said
