"""The files that decide what is read from a data file are listed, and nothing else."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS

from survey import Dem, Grid, InputError
from survey.io.dataset_files import companion_files, raster_sources
from survey.io.vector import write_features

UTM = "EPSG:32608"
MOSAIC = """<VRTDataset rasterXSize="4" rasterYSize="3"><SRS>EPSG:32608</SRS>
<GeoTransform>0, 10, 0, 30, 0, -10</GeoTransform><VRTRasterBand dataType="Float32" band="1">
{bands}</VRTRasterBand></VRTDataset>"""


def source(name: str, relative: int = 1) -> str:
    return (
        f'<SimpleSource><SourceFilename relativeToVRT="{relative}">{name}</SourceFilename>'
        "<SourceBand>1</SourceBand></SimpleSource>"
    )


def tile(path: Path) -> Path:
    Dem.on(Grid((5.0, 5.0, 35.0, 25.0), 10.0, UTM), np.ones((3, 4))).write(path)
    return path


def names(files: list[Path]) -> list[str]:
    return [file.name for file in files]


def test_a_shapefile_has_its_attributes_index_and_crs(tmp_path: Path) -> None:
    write_features(tmp_path / "a.shp", [shapely.box(0, 0, 9, 9)], {}, CRS(UTM), layer="a")
    (tmp_path / "b.prj").write_text("another file's")
    assert names(companion_files(tmp_path / "a.shp")) == ["a.cpg", "a.dbf", "a.prj", "a.shx"]


def test_a_raster_has_its_metadata_mask_and_world_file_whatever_their_case(tmp_path: Path) -> None:
    tile(tmp_path / "a.tif")
    for name in ("a.TFW", "a.tif.aux.xml", "a.tif.msk", "a.tif.ovr", "other.tfw"):
        (tmp_path / name).write_text("x")
    assert names(companion_files(tmp_path / "a.tif")) == ["a.TFW", "a.tif.aux.xml", "a.tif.msk"]


def test_a_geopackage_has_its_journal(tmp_path: Path) -> None:
    (tmp_path / "a.gpkg").write_text("x")
    (tmp_path / "a.gpkg-wal").write_text("x")
    assert names(companion_files(tmp_path / "a.gpkg")) == ["a.gpkg-wal"]


def test_a_virtual_raster_has_the_sources_of_its_sources_with_what_stands_beside_them(tmp_path: Path) -> None:
    tiles = tmp_path / "tiles"
    tiles.mkdir()
    tile(tiles / "one.tif")
    (tiles / "one.tif.aux.xml").write_text("<PAMDataset/>")
    (tiles / "inner.vrt").write_text(MOSAIC.format(bands=source("one.tif")))
    tile(tmp_path / "two.tif")
    mosaic = tmp_path / "all.vrt"
    mosaic.write_text(MOSAIC.format(bands=source("tiles/inner.vrt") + source(str(tmp_path / "two.tif"), 0)))
    found = {str(file.relative_to(tmp_path)) for file in companion_files(mosaic)}
    assert found == {"tiles/inner.vrt", "tiles/one.tif", "tiles/one.tif.aux.xml", "two.tif"}


@pytest.mark.parametrize(
    "text",
    [
        source("/vsicurl/http://127.0.0.1/a.tif", 0),
        source("http://127.0.0.1/a.tif", 0),
        source("NETCDF:a.nc:z", 0),
        source("&lt;VRTDataset/&gt;", 0),
        source("missing.tif"),
        source(" one.tif"),
        source("one.tif").replace("relativeToVRT", "RELATIVETOVRT"),
        "<SimpleSource><SourceDataset>a.tif</SourceDataset></SimpleSource>",
        "<PixelFunctionCode>import os</PixelFunctionCode>",
    ],
)
def test_a_source_that_is_no_local_file_is_refused(text: str, tmp_path: Path) -> None:
    tile(tmp_path / "one.tif")
    (tmp_path / "a.vrt").write_text(MOSAIC.format(bands=text))
    with pytest.raises(InputError):
        raster_sources(tmp_path / "a.vrt")


@pytest.mark.parametrize("kind", ["VRTDerivedRasterBand", "VRTRawRasterBand", "VRTWarpedRasterBand"])
def test_bands_that_are_no_mosaic_are_refused(kind: str, tmp_path: Path) -> None:
    text = MOSAIC.format(bands="").replace("<VRTRasterBand", f'<VRTRasterBand subClass="{kind}"')
    (tmp_path / "a.vrt").write_text(text)
    with pytest.raises(InputError, match="plain mosaics"):
        raster_sources(tmp_path / "a.vrt")


def test_virtual_rasters_that_are_made_of_themselves_are_refused(tmp_path: Path) -> None:
    for name, other in (("a", "a"), ("b", "c"), ("c", "d"), ("d", "link")):
        (tmp_path / f"{name}.vrt").write_text(MOSAIC.format(bands=source(f"{other}.vrt")))
    (tmp_path / "link.vrt").symlink_to(tmp_path / "b.vrt")
    for name, words in (
        ("a", r"a\.vrt names a\.vrt"),
        ("b", r"d\.vrt names link\.vrt"),
        ("d", r"c\.vrt names d"),
    ):
        with pytest.raises(InputError, match=f"{words}.* as a source, which is made of"):
            Dem.read(tmp_path / f"{name}.vrt")


def test_a_source_that_is_named_twice_is_no_circle(tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_bytes(b"x")
    (tmp_path / "inner.vrt").write_text(MOSAIC.format(bands=source("a.tif")))
    (tmp_path / "outer.vrt").write_text(MOSAIC.format(bands=2 * source("inner.vrt")))
    assert names(raster_sources(tmp_path / "outer.vrt")) == ["a.tif", "inner.vrt"]


def test_entities_are_refused(tmp_path: Path) -> None:
    entity = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/hostname">]>'
    (tmp_path / "a.vrt").write_text(entity + MOSAIC.format(bands=source("a.tif")))
    with pytest.raises(InputError, match="entities"):
        raster_sources(tmp_path / "a.vrt")
