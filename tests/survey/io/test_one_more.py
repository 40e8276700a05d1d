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
from survey.io.point_chunks import CHUNKED_SUFFIXES
from survey.io.point_files import READ_ENDINGS
from survey.io.vector import write_features
from survey.reconstruction.tiled.job import TiledConfig, tiled_job

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


def parquet(file: Path) -> str:
    """Write classes of points, which LAS has in its records, as a column."""
    import pyarrow as pa
    from pyarrow import parquet as files

    files.write_table(pa.table({**dict(zip("xyz", XYZ.T, strict=True)), "classification": [2, 7, 2]}), file)
    return "not used: classification"


CHUNKED: dict[str, Callable[[Path], str]] = {
    **dict.fromkeys((".las", ".laz"), las),
    ".ply": ply,
    ".parquet": parquet,
}


def test_every_reader_in_chunks_is_in_the_table() -> None:
    assert set(CHUNKED) == set(CHUNKED_SUFFIXES)


@pytest.mark.parametrize("ending", CHUNKED)
def test_readers_in_chunks_name_what_they_leave_out(tmp_path: Path, ending: str, caplog: Any) -> None:
    word = CHUNKED[ending](tmp_path / f"a{ending}")
    crs = None if ending in (".las", ".laz") else "EPSG:32608"
    with caplog.at_level(logging.WARNING):
        tiled_job([tmp_path / f"a{ending}"], tmp_path / "map", TiledConfig(), crs=crs)
    assert word in caplog.text


RASTERS: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("an unknown unit", {}, {"units": ("furlong",)}, "counts in 'furlong'"),
    ("a unit of feet", {}, {"units": ("ft",)}, "heights in feet"),
    ("a vertical system in feet", {"crs": "EPSG:32608+6360"}, {}, "heights in US survey feet"),
    ("a system in feet", {"crs": "EPSG:2263"}, {}, "--units"),
    ("depths", {}, {"tags": {"positive": "down"}}, "counts downwards"),
    ("a mark that is not declared", {"mark": -9999.0}, {}, "not declared as nodata"),
    ("a band more", {"bands": 2}, {}, "a.tif has 2 bands; band 1 is read"),
    ("a unit beside another system", {"crs": "EPSG:32608+6360"}, {"units": ("m",)}, "correct one of them"),
]


@pytest.mark.parametrize(("name", "made", "also", "word"), RASTERS)
def test_readers_of_rasters_use_refuse_or_name_it(
    tmp_path: Path, name: str, made: dict[str, Any], also: dict[str, Any], word: str, caplog: Any
) -> None:
    del name
    place = Affine(10.0, 0.0, 5e5, 0.0, -10.0, 6.7e6)
    profile = {
        "height": 5,
        "width": 5,
        "count": made.get("bands", 1),
        "dtype": "float32",
        "driver": "GTiff",
        "transform": place,
    }
    values = np.arange(300.0, 325.0).reshape(5, 5)
    values[0, 0] = made.get("mark", values[0, 0])
    with rasterio.open(tmp_path / "a.tif", "w", crs=made.get("crs", "EPSG:32608"), **profile) as target:
        target.write(np.stack([values] * target.count).astype("f4"))
        target.units = also.get("units", target.units)
        target.update_tags(1, **also.get("tags", {}))
    with caplog.at_level(logging.WARNING):
        try:
            Dem.read(tmp_path / "a.tif")
            said = caplog.text
        except InputError as error:
            said = str(error)
    assert word in said


def test_bands_with_marks_of_their_own_are_read_by_them(tmp_path: Path) -> None:
    place = Affine(10.0, 0.0, 5e5, 0.0, -10.0, 6.7e6)
    values = np.arange(300.0, 325.0).reshape(5, 5)
    profile = {
        "height": 5,
        "width": 5,
        "count": 2,
        "dtype": "float32",
        "crs": "EPSG:32608",
        "transform": place,
    }
    with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", **profile) as target:
        target.write(np.stack([values, values + 100.0]).astype("f4"))
    bands = "".join(
        f'<VRTRasterBand dataType="Float32" band="{k}"><NoDataValue>{mark}</NoDataValue><SimpleSource><SourceFilename relativeToVRT="1">a.tif'
        f"</SourceFilename><SourceBand>{k}</SourceBand></SimpleSource></VRTRasterBand>"
        for k, mark in ((1, 312), (2, 400))
    )
    (tmp_path / "a.vrt").write_text(
        f'<VRTDataset rasterXSize="5" rasterYSize="5"><SRS>EPSG:32608</SRS><GeoTransform>{", ".join(map(str, place.to_gdal()))}'
        f"</GeoTransform>{bands}</VRTDataset>"
    )
    for band, mark in ((1, 312.0), (2, 400.0)):
        dem = Dem.read(tmp_path / "a.vrt", band=band)
        assert np.array_equal(np.isnan(dem.elevation), values + 100.0 * (band - 1) == mark)


def test_packed_numbers_of_netcdf_are_unpacked(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    values = np.arange(300.0, 325.0).reshape(5, 5)
    values[0, 0] = np.nan
    axes = {
        "y": ("y", 6_700_045.0 - 10.0 * np.arange(5), {"standard_name": "projection_y_coordinate"}),
        "x": ("x", 500_005.0 + 10.0 * np.arange(5), {"standard_name": "projection_x_coordinate"}),
    }
    variables = {
        "z": (("y", "x"), values, {"units": "m", "grid_mapping": "crs"}),
        "crs": ((), 0, UTM.to_cf()),
    }
    packed = {"dtype": "int16", "scale_factor": 0.5, "add_offset": 250.0, "_FillValue": -9999}
    dataset = xarray.Dataset(variables, axes)
    dataset.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding={"z": packed})
    assert Dem.read(tmp_path / "a.nc").elevation == pytest.approx(values, nan_ok=True)
