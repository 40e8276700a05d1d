"""Virtual rasters of local files are read; formats beside GeoTIFF keep working by their suffix."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from survey import Dem, Grid, InputError
from survey.io.raster import band_count, raster_facts

UTM = "EPSG:32608"
GRID = Grid((5.0, 5.0, 95.0, 45.0), 10.0, UTM)


def mosaic(folder: Path, sources: list[str]) -> Path:
    """Write a virtual raster of tiles of 5 × 10 cells side by side, as gdalbuildvrt does."""
    parts = "".join(
        f'<ComplexSource><SourceFilename relativeToVRT="1">{name}</SourceFilename><SourceBand>1</SourceBand>'
        '<SourceProperties RasterXSize="10" RasterYSize="5" DataType="Float32" BlockXSize="10" BlockYSize="5"/>'
        f'<SrcRect xOff="0" yOff="0" xSize="10" ySize="5"/><DstRect xOff="{10 * k}" yOff="0" xSize="10" ySize="5"/>'
        "<NODATA>-9999</NODATA></ComplexSource>"
        for k, name in enumerate(sources)
    )
    (folder / "all.vrt").write_text(
        f'<VRTDataset rasterXSize="{10 * len(sources)}" rasterYSize="5"><SRS dataAxisToSRSAxisMapping="1,2">{UTM}</SRS>'
        "<GeoTransform>0, 10, 0, 50, 0, -10</GeoTransform>"
        f'<VRTRasterBand dataType="Float32" band="1"><NoDataValue>-9999</NoDataValue>{parts}</VRTRasterBand></VRTDataset>'
    )
    return folder / "all.vrt"


def test_a_mosaic_of_local_tiles_is_read(tmp_path: Path) -> None:
    (tmp_path / "tiles").mkdir()
    tiles = [np.random.default_rng(k).normal(size=(5, 10)).astype(np.float32) for k in range(2)]
    for ending, tile in zip(("tif", "asc"), tiles, strict=True):
        Dem.on(GRID, tile).write(tmp_path / "tiles" / f"a.{ending}")
    file = mosaic(tmp_path, ["tiles/a.tif", "tiles/a.asc"])
    np.testing.assert_array_equal(Dem.read(file).elevation, np.hstack(tiles))
    assert raster_facts(file).shape == (5, 20)
    assert band_count(file) == 1


def test_letters_in_a_tile_of_a_mosaic_are_refused(tmp_path: Path) -> None:
    Dem.on(GRID, np.ones((5, 10))).write(tmp_path / "a.asc")
    text = (tmp_path / "a.asc").read_text()
    (tmp_path / "a.asc").write_text(text[:-4] + "x\n")
    with pytest.raises(InputError):
        Dem.read(mosaic(tmp_path, ["a.asc"]))


@pytest.mark.parametrize(("suffix", "driver"), [("bil", "EHdr"), ("flt", "EHdr"), ("tiff", "GTiff")])
def test_other_suffixes_have_their_driver(suffix: str, driver: str, tmp_path: Path) -> None:
    profile = {"height": 5, "width": 10, "count": 1, "dtype": "float32", "crs": UTM}
    place = Affine(10.0, 0.0, 0.0, 0.0, -10.0, 50.0)
    values = np.arange(50.0, dtype=np.float32).reshape(5, 10)
    with rasterio.open(tmp_path / f"a.{suffix}", "w", driver=driver, transform=place, **profile) as target:
        target.write(values, 1)
    np.testing.assert_array_equal(Dem.read(tmp_path / f"a.{suffix}", crs=UTM).elevation, values)


def test_statistics_in_a_metadata_file_do_no_harm(tmp_path: Path) -> None:
    Dem.on(GRID, np.ones((5, 10))).write(tmp_path / "a.tif")
    (tmp_path / "a.tif.aux.xml").write_text(
        '<PAMDataset><PAMRasterBand band="1"><Metadata><MDI key="STATISTICS_MEAN">1</MDI></Metadata>'
        "</PAMRasterBand></PAMDataset>"
    )
    assert Dem.read(tmp_path / "a.tif").elevation.mean() == 1.0
