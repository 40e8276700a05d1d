"""Damaged deflate blocks of a GeoTIFF are refused, sound ones of every layout pass."""

import numpy as np
import pytest
import rasterio
from affine import Affine

from survey import Dem, InputError

HEIGHTS = (100.0 + np.random.default_rng(5).normal(size=(300, 300))).astype(np.float32)
LAYOUTS = [
    {"compress": "deflate"},
    {"compress": "deflate", "tiled": True, "blockxsize": 128, "blockysize": 128},
    {"compress": "deflate", "predictor": 3},
    {"compress": "lzw"},
    {},
]


def write(path, **profile):
    place = Affine(3.0, 0.0, 500_000.0, 0.0, -3.0, 6_700_000.0)
    settings = {"count": 1, "height": 300, "width": 300, "dtype": "float32", **profile}
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:32608", transform=place, **settings) as target:
        target.write(HEIGHTS, 1)


@pytest.mark.parametrize("profile", LAYOUTS, ids=str)
def test_sound_blocks_are_read(tmp_path, profile):
    write(tmp_path / "dem.tif", **profile)
    assert np.array_equal(Dem.read(tmp_path / "dem.tif").elevation.astype(np.float32), HEIGHTS)


@pytest.mark.parametrize("profile", LAYOUTS[:3], ids=str)
def test_a_block_with_a_wrong_checksum_is_refused(tmp_path, profile):
    path = tmp_path / "dem.tif"
    write(path, **profile)
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 8] = bytes(8)
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match=r"dem\.tif is damaged"):
        Dem.read(path)


def virtual(folder, *places):
    """Write a virtual raster of dem.tif at places (columns, rows)."""
    parts = "".join(
        '<SimpleSource><SourceFilename relativeToVRT="1">dem.tif</SourceFilename><SourceBand>1</SourceBand>'
        f'<SrcRect xOff="0" yOff="0" xSize="300" ySize="300"/><DstRect XOFF="{column}" yOff="{row}" xSize="300" '
        'ySize="300"/></SimpleSource>'
        for column, row in places
    )
    (folder / "all.vrt").write_text(
        '<VRTDataset rasterXSize="600" rasterYSize="600"><SRS>EPSG:32608</SRS>'
        "<GeoTransform>500000, 3, 0, 6700000, 0, -3</GeoTransform>"
        f'<VRTRasterBand dataType="Float32" band="1">{parts}</VRTRasterBand></VRTDataset>'
    )
    (folder / "outer.vrt").write_text(
        '<VRTDataset rasterXSize="600" rasterYSize="600"><SRS>EPSG:32608</SRS>'
        "<GeoTransform>500000, 3, 0, 6700000, 0, -3</GeoTransform>"
        '<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="1">all.vrt'
        '</SourceFilename><SrcRect xSize="600" ySize="600"/><DstRect xSize="600" ySize="600"/>'
        "</SimpleSource></VRTRasterBand></VRTDataset>"
    )


@pytest.mark.parametrize("name", ["all.vrt", "outer.vrt"])
def test_a_damaged_source_of_a_virtual_raster_is_refused_where_a_window_touches_it(tmp_path, name):
    path = tmp_path / "dem.tif"
    write(path, compress="deflate")
    virtual(tmp_path, (0, 0), (300, 0), (0, 300), (300, 300))
    assert Dem.read(tmp_path / name).shape == (600, 600)
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 8] = bytes(8)
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match=r"is damaged .*dem\.tif: the checksum of block"):
        Dem.read(tmp_path / name)
    virtual(tmp_path, (0, 0))
    elsewhere = (500_000.0 + 1000.0, 6_700_000.0 - 1700.0, 500_000.0 + 1700.0, 6_700_000.0 - 1000.0)
    Dem.read(tmp_path / name, bounds=elsewhere)
