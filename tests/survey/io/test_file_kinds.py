"""A file is opened in the format of its ending, and leads nowhere else."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from survey.core.errors import InputError
from survey.io.file_kinds import check_raster_file, check_vector_file


@pytest.fixture
def raster(tmp_path: Path) -> Path:
    profile = {
        "driver": "GTiff",
        "height": 3,
        "width": 3,
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:32608",
    }
    with rasterio.open(tmp_path / "a.tif", "w", **profile, transform=Affine(1, 0, 0, 0, -1, 3)) as target:
        target.write(np.ones((3, 3), np.float32), 1)
    return tmp_path / "a.tif"


def test_a_raster_of_its_kind_passes(raster: Path) -> None:
    check_raster_file(raster)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.png", r"ends in '.png'; a raster ending in"),
        ("a.nc", "is damaged or no raster of the kind .nc"),
    ],
)
def test_another_ending_or_content_is_refused(raster: Path, name: str, words: str) -> None:
    other = raster.rename(raster.with_name(name))
    with pytest.raises(InputError, match=words):
        check_raster_file(other)


@pytest.mark.parametrize("words", ["<VRTDataset>", "<GDAL_WMS>", "<WMS_Capabilities>", '{"stac_version": 1}'])
def test_a_text_raster_with_the_words_of_another_format_is_refused(tmp_path: Path, words: str) -> None:
    file = tmp_path / "a.asc"
    file.write_text(words)
    with pytest.raises(InputError, match="which belongs to a format that reads other files or addresses"):
        check_raster_file(file)


def test_netcdf_is_no_source_of_a_virtual_raster(raster: Path) -> None:
    with pytest.raises(InputError, match=r"ends in '.nc'"):
        check_raster_file(raster.rename(raster.with_name("a.nc")), as_source=True)


@pytest.mark.parametrize(
    "content",
    [
        "<PAMDataset><Metadata domain='OVERVIEWS'><MDI key='OVERVIEW_FILE'>/etc/passwd</MDI></Metadata></PAMDataset>",
        "<PAMDataset>/vsicurl/http://a.b/c.tif</PAMDataset>",
        "<!DOCTYPE a [<!ENTITY b 'c'>]><PAMDataset/>",
    ],
)
def test_a_companion_that_names_other_files_is_refused(raster: Path, content: str) -> None:
    raster.with_name("a.tif.aux.xml").write_text(content)
    with pytest.raises(InputError, match="names other files or declares XML entities"):
        check_raster_file(raster)


def test_a_companion_with_a_comment_passes(raster: Path) -> None:
    raster.with_name("a.tif.aux.xml").write_text("<PAMDataset><!-- by hand --></PAMDataset>")
    check_raster_file(raster)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.dxf", b"", r"the area .*ends in '.dxf'"),
        ("a.gpkg", b"PK\x03\x04", "is damaged or no area of the kind .gpkg"),
        ("a.geojson", b'{"crs": {"type": "link"}}', "links are not followed"),
        ("a.gpx", b"<kml/>", "a <gpx> document"),
    ],
)
def test_a_vector_file_of_another_kind_is_refused(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(InputError, match=words):
        check_vector_file(file, "the area")
