"""Rasters that lead to an address or to another file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from tests.reliability.bait.places import CANARY, UTM, Bait, Places, text_bait

RASTERS: dict[str, Bait] = {}


def raster(bait: Bait) -> Bait:
    RASTERS[bait.__name__] = bait
    return bait


def text(name: str, file: str, content: Callable[[Places], str]) -> None:
    RASTERS[name] = text_bait(file, content)


def tif(path: Path, value: float = 1.0) -> Path:
    profile = {"height": 40, "width": 40, "count": 1, "dtype": "float32", "crs": UTM}
    place = Affine(10.0, 0.0, 0.0, 0.0, -10.0, 400.0)
    with rasterio.open(path, "w", driver="GTiff", transform=place, **profile) as target:
        target.write(np.full((40, 40), value, dtype=np.float32), 1)
    return path


def wms(url: str) -> str:
    return (
        f'<GDAL_WMS><Service name="TMS"><ServerUrl>{url}/${{z}}/${{x}}/${{y}}.png</ServerUrl></Service><DataWindow>'
        "<UpperLeftX>0</UpperLeftX><UpperLeftY>400</UpperLeftY><LowerRightX>400</LowerRightX><LowerRightY>0</LowerRightY>"
        "<TileLevel>1</TileLevel><SizeX>40</SizeX><SizeY>40</SizeY></DataWindow><Projection>EPSG:32608</Projection>"
        "<BandsCount>1</BandsCount><DataType>Float32</DataType></GDAL_WMS>"
    )


def vrt(source: str, band: str = "") -> str:
    return (
        f'<VRTDataset rasterXSize="40" rasterYSize="40"><SRS>{UTM}</SRS><GeoTransform>0,10,0,400,0,-10</GeoTransform>'
        f'<VRTRasterBand dataType="Float32" band="1" {band}><SimpleSource>'
        f'<SourceFilename relativeToVRT="0">{source}</SourceFilename>'
        "<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
    )


for ending in ("tif", "asc", "nc", "hgt", "bil", "vrt"):
    text(f"wms_as_{ending}", f"a.{ending}", lambda p: wms(p.url))
for ending in ("tif", "asc", "nc", "vrt"):
    text(f"vrt_with_address_as_{ending}", f"a.{ending}", lambda p: vrt(f"/vsicurl/{p.url}/x.tif"))
text("vrt_with_plain_address", "a.vrt", lambda p: vrt(f"{p.url}/x.tif"))
text("vrt_with_streamed_address", "a.vrt", lambda p: vrt(f"/vsicurl_streaming/{p.url}/x.tif"))
text("vrt_with_wms_inside", "a.vrt", lambda p: vrt(wms(p.url).replace("<", "&lt;")))
text("vrt_with_archive", "a.vrt", lambda p: vrt(f"/vsizip//vsicurl/{p.url}/x.zip/x.tif"))
text(
    "vrt_with_raw_file",
    "a.vrt",
    lambda p: vrt(str(p.canary), 'subClass="VRTRawRasterBand"'),
)
text(
    "vrt_with_python",
    "a.vrt",
    lambda p: vrt(str(p.canary), 'subClass="VRTDerivedRasterBand"').replace(
        "<SimpleSource>",
        "<PixelFunctionType>f</PixelFunctionType><PixelFunctionLanguage>Python</PixelFunctionLanguage>"
        f"<PixelFunctionCode>import urllib.request; urllib.request.urlopen('{p.url}')</PixelFunctionCode><SimpleSource>",
    ),
)
text(
    "vrt_with_entity",
    "a.vrt",
    lambda p: f'<!DOCTYPE x [<!ENTITY e SYSTEM "{p.url}/e">]>' + vrt("&e;"),
)


@raster
def vrt_of_a_vrt_with_address(folder: Path, places: Places) -> Path:
    (folder / "inner.vrt").write_text(vrt(f"/vsicurl/{places.url}/inner.tif"))
    (folder / "a.vrt").write_text(vrt(str(folder / "inner.vrt")))
    return folder / "a.vrt"


@raster
def vrt_of_a_tif_that_is_wms(folder: Path, places: Places) -> Path:
    (folder / "tile.tif").write_text(wms(places.url))
    (folder / "a.vrt").write_text(vrt(str(folder / "tile.tif")))
    return folder / "a.vrt"


@raster
def tif_with_wms_as_mask(folder: Path, places: Places) -> Path:
    (folder / "a.tif.msk").write_text(wms(places.url))
    return tif(folder / "a.tif")


@raster
def tif_with_wms_as_overviews(folder: Path, places: Places) -> Path:
    (folder / "a.tif.ovr").write_text(wms(places.url))
    return tif(folder / "a.tif")


@raster
def tif_with_address_of_overviews(folder: Path, places: Places) -> Path:
    with rasterio.open(tif(folder / "a.tif"), "r+") as target:
        target.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=f"/vsicurl/{places.url}/o.tif")
    return folder / "a.tif"


@raster
def tif_with_address_in_its_metadata_file(folder: Path, places: Places) -> Path:
    item = f'<MDI key="OVERVIEW_FILE">/vsicurl/{places.url}/o.tif</MDI>'
    (folder / "a.tif.aux.xml").write_text(
        f'<PAMDataset><Metadata domain="OVERVIEWS">{item}</Metadata></PAMDataset>'
    )
    return tif(folder / "a.tif")


@raster
def netcdf_with_values_in_another_file(folder: Path, places: Places) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "a.nc", "w") as file:
        file.create_dataset("z", (40, 40), "f8", external=[(str(places.canary), 0, h5py.h5f.UNLIMITED)])
    return folder / "a.nc"


@raster
def netcdf_with_link_to_another_file(folder: Path, places: Places) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "other.h5", "w") as file:
        file["z"] = np.full((40, 40), CANARY)
    with h5py.File(folder / "a.nc", "w") as file:
        file["z"] = h5py.ExternalLink(str(folder / "other.h5"), "z")
    return folder / "a.nc"
