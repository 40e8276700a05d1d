"""No data file opens a connection or reads a file other than its own, whatever stands in it."""

import json
import os
import socket
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from pyproj import CRS

from sim.mission.runs import open_run, read_mission
from survey import Dem, SurveyArea
from survey.core.errors import FirnlineError
from survey.data.surface_points import SurfacePoints
from survey.io.raster import band_count, raster_facts
from survey.io.tracks import read_track
from survey.io.vector import write_features
from survey.scoring.blocks import score_files

pytestmark = pytest.mark.reliability

UTM = "EPSG:32608"
CANARY = 1234.5


class Places(NamedTuple):
    """Where the bait leads: an address that is listened to, and a file that must not be read."""

    url: str
    canary: Path


@pytest.fixture
def contacts() -> Iterator[tuple[str, list[bytes]]]:
    """Listen on a local port, and note whoever connects."""
    found: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.05)
        closing = threading.Event()

        def listen() -> None:
            while not closing.is_set():
                try:
                    visitor, _ = server.accept()
                except TimeoutError:
                    continue
                with visitor:
                    visitor.settimeout(1.0)
                    found.append(visitor.recv(200))
                    visitor.sendall(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")

        thread = threading.Thread(target=listen)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}", found
        closing.set()
        thread.join()


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


Bait = Callable[[Path, Places], Path]
RASTERS: dict[str, Bait] = {}
VECTORS: dict[str, Bait] = {}


def raster_bait(bait: Bait) -> Bait:
    RASTERS[bait.__name__] = bait
    return bait


def text_bait(kinds: dict[str, Bait], name: str, file: str, text: Callable[[Places], str]) -> None:
    def write(folder: Path, places: Places) -> Path:
        (folder / file).write_text(text(places))
        return folder / file

    kinds[name] = write


for ending in ("tif", "asc", "nc", "hgt", "bil", "vrt"):
    text_bait(RASTERS, f"wms_as_{ending}", f"a.{ending}", lambda p: wms(p.url))
for ending in ("tif", "asc", "nc", "vrt"):
    text_bait(
        RASTERS, f"vrt_with_address_as_{ending}", f"a.{ending}", lambda p: vrt(f"/vsicurl/{p.url}/x.tif")
    )
text_bait(RASTERS, "vrt_with_plain_address", "a.vrt", lambda p: vrt(f"{p.url}/x.tif"))
text_bait(RASTERS, "vrt_with_streamed_address", "a.vrt", lambda p: vrt(f"/vsicurl_streaming/{p.url}/x.tif"))
text_bait(RASTERS, "vrt_with_wms_inside", "a.vrt", lambda p: vrt(wms(p.url).replace("<", "&lt;")))
text_bait(RASTERS, "vrt_with_archive", "a.vrt", lambda p: vrt(f"/vsizip//vsicurl/{p.url}/x.zip/x.tif"))
text_bait(
    RASTERS,
    "vrt_with_raw_file",
    "a.vrt",
    lambda p: vrt(str(p.canary), 'subClass="VRTRawRasterBand"'),
)
text_bait(
    RASTERS,
    "vrt_with_python",
    "a.vrt",
    lambda p: vrt(str(p.canary), 'subClass="VRTDerivedRasterBand"').replace(
        "<SimpleSource>",
        "<PixelFunctionType>f</PixelFunctionType><PixelFunctionLanguage>Python</PixelFunctionLanguage>"
        f"<PixelFunctionCode>import urllib.request; urllib.request.urlopen('{p.url}')</PixelFunctionCode><SimpleSource>",
    ),
)
text_bait(
    RASTERS,
    "vrt_with_entity",
    "a.vrt",
    lambda p: f'<!DOCTYPE x [<!ENTITY e SYSTEM "{p.url}/e">]>' + vrt("&e;"),
)


@raster_bait
def vrt_of_a_vrt_with_address(folder: Path, places: Places) -> Path:
    (folder / "inner.vrt").write_text(vrt(f"/vsicurl/{places.url}/inner.tif"))
    (folder / "a.vrt").write_text(vrt(str(folder / "inner.vrt")))
    return folder / "a.vrt"


@raster_bait
def vrt_of_a_tif_that_is_wms(folder: Path, places: Places) -> Path:
    (folder / "tile.tif").write_text(wms(places.url))
    (folder / "a.vrt").write_text(vrt(str(folder / "tile.tif")))
    return folder / "a.vrt"


@raster_bait
def tif_with_wms_as_mask(folder: Path, places: Places) -> Path:
    (folder / "a.tif.msk").write_text(wms(places.url))
    return tif(folder / "a.tif")


@raster_bait
def tif_with_wms_as_overviews(folder: Path, places: Places) -> Path:
    (folder / "a.tif.ovr").write_text(wms(places.url))
    return tif(folder / "a.tif")


@raster_bait
def tif_with_address_of_overviews(folder: Path, places: Places) -> Path:
    with rasterio.open(tif(folder / "a.tif"), "r+") as target:
        target.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=f"/vsicurl/{places.url}/o.tif")
    return folder / "a.tif"


@raster_bait
def tif_with_address_in_its_metadata_file(folder: Path, places: Places) -> Path:
    item = f'<MDI key="OVERVIEW_FILE">/vsicurl/{places.url}/o.tif</MDI>'
    (folder / "a.tif.aux.xml").write_text(
        f'<PAMDataset><Metadata domain="OVERVIEWS">{item}</Metadata></PAMDataset>'
    )
    return tif(folder / "a.tif")


@raster_bait
def netcdf_with_values_in_another_file(folder: Path, places: Places) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "a.nc", "w") as file:
        file.create_dataset("z", (40, 40), "f8", external=[(str(places.canary), 0, h5py.h5f.UNLIMITED)])
    return folder / "a.nc"


@raster_bait
def netcdf_with_link_to_another_file(folder: Path, places: Places) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "other.h5", "w") as file:
        file["z"] = np.full((40, 40), CANARY)
    with h5py.File(folder / "a.nc", "w") as file:
        file["z"] = h5py.ExternalLink(str(folder / "other.h5"), "z")
    return folder / "a.nc"


def geojson(crs: object) -> str:
    square = shapely.geometry.mapping(shapely.box(0, 0, 400, 400))
    feature = {"type": "Feature", "properties": {}, "geometry": square}
    return json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]})


def pipeline(p: Places) -> str:
    return json.dumps(
        {
            "type": "gdal_streamed_alg",
            "command_line": f"gdal vector pipeline ! read /vsicurl/{p.url}/g.geojson",
        }
    )


def kml(p: Places, inside: str, before: str = "") -> str:
    return f'{before}<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{inside}</Document></kml>'


def ogr_vrt(p: Places) -> str:
    return (
        f'<OGRVRTDataSource><OGRVRTLayer name="x"><SrcDataSource>/vsicurl/{p.url}/v.geojson</SrcDataSource>'
        "</OGRVRTLayer></OGRVRTDataSource>"
    )


for ending in ("geojson", "json", "kml", "gpx", "gpkg", "shp", "fgb"):
    text_bait(VECTORS, f"ogr_vrt_as_{ending}", f"a.{ending}", ogr_vrt)
for ending in ("geojson", "kml"):
    text_bait(
        VECTORS,
        f"wfs_as_{ending}",
        f"a.{ending}",
        lambda p: f"<OGRWFSDataSource><URL>{p.url}/wfs</URL></OGRWFSDataSource>",
    )
text_bait(VECTORS, "pipeline_as_geojson", "a.geojson", pipeline)
text_bait(VECTORS, "pipeline_as_json", "a.json", pipeline)
text_bait(
    VECTORS,
    "linked_crs",
    "a.geojson",
    lambda p: geojson({"type": "link", "properties": {"href": f"{p.url}/c", "type": "ogcwkt"}}),
)
text_bait(
    VECTORS,
    "linked_crs_with_escapes",
    "a.geojson",
    lambda p: geojson({"type": "link", "properties": {"href": f"{p.url}/c"}}).replace('"crs"', '"\\u0063rs"'),
)
text_bait(
    VECTORS,
    "crs_by_address",
    "a.geojson",
    lambda p: geojson({"type": "url", "properties": {"url": f"{p.url}/c"}}),
)
text_bait(
    VECTORS,
    "crs_named_by_address",
    "a.geojson",
    lambda p: geojson({"type": "name", "properties": {"name": f"{p.url}/c"}}),
)
text_bait(
    VECTORS,
    "crs_named_by_path",
    "a.geojson",
    lambda p: geojson({"type": "name", "properties": {"name": str(p.canary)}}),
)
text_bait(
    VECTORS,
    "network_link",
    "a.kml",
    lambda p: kml(p, f"<NetworkLink><Link><href>{p.url}/n.kml</href></Link></NetworkLink>"),
)
text_bait(
    VECTORS,
    "entity_in_kml",
    "a.kml",
    lambda p: kml(
        p,
        "<Placemark><name>&e;</name><Point><coordinates>1,2</coordinates></Point></Placemark>",
        f'<!DOCTYPE k [<!ENTITY e SYSTEM "{p.url}/e">]>',
    ),
)
text_bait(
    VECTORS,
    "entity_in_gpx",
    "a.gpx",
    lambda p: (
        f'<!DOCTYPE k [<!ENTITY e SYSTEM "{p.canary}">]><gpx version="1.1"><wpt lat="1" lon="2"><name>&e;</name></wpt></gpx>'
    ),
)
text_bait(
    VECTORS,
    "gml_with_schema",
    "a.kml",
    lambda p: (
        '<gml:FeatureCollection xmlns:gml="http://www.opengis.net/gml" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        f'xsi:schemaLocation="http://x {p.url}/s.xsd"/>'
    ),
)


def geopackage_with_virtual_table(folder: Path, places: Places) -> Path:
    write_features(folder / "a.gpkg", [shapely.box(0, 0, 400, 400)], {}, CRS(UTM), layer="a")
    database = sqlite3.connect(folder / "a.gpkg")
    database.execute("PRAGMA writable_schema=1")
    sql = f"CREATE VIRTUAL TABLE v USING VirtualOGR('/vsicurl/{places.url}/v.geojson')"
    database.execute(
        "INSERT INTO sqlite_master(type,name,tbl_name,rootpage,sql) VALUES('table','v','v',0,?)", (sql,)
    )
    database.execute(
        "INSERT INTO gpkg_contents(table_name,data_type,identifier,srs_id) VALUES('v','attributes','v',0)"
    )
    database.commit()
    database.close()
    return folder / "a.gpkg"


VECTORS["geopackage_with_virtual_table"] = geopackage_with_virtual_table
ANSWERS = {"geopackage_with_virtual_table"}  # the layer with the outline is read, the table is not


def refused(read: Callable[[], object]) -> bool:
    try:
        read()
    except FirnlineError as refusal:
        return "\n" not in str(refusal)
    return False


def bait(write: Bait, folder: Path, url: str) -> Path:
    canary = folder / "canary" / "canary.bin"
    canary.parent.mkdir()
    canary.write_bytes(np.full((40, 40), CANARY).tobytes())
    return write(folder, Places(url, canary))


@pytest.mark.parametrize("name", RASTERS)
def test_no_raster_leads_elsewhere(name: str, tmp_path: Path, contacts: tuple[str, list[bytes]]) -> None:
    url, found = contacts
    file = bait(RASTERS[name], tmp_path, url)
    good = tif(tmp_path / "good.tif")
    for read in (
        lambda: Dem.read(file, crs=UTM),
        lambda: Dem.read(file, crs=UTM, band=2),
        lambda: raster_facts(file),
        lambda: band_count(file),
        lambda: score_files(file, good),
        lambda: score_files(good, file),
    ):
        assert refused(read) or name == "tif_with_address_of_overviews"
    assert found == []


@pytest.mark.parametrize("name", VECTORS)
def test_no_vector_file_leads_elsewhere(name: str, tmp_path: Path, contacts: tuple[str, list[bytes]]) -> None:
    url, found = contacts
    file = bait(VECTORS[name], tmp_path, url)
    for read in (
        lambda: SurveyArea.read(file, crs=UTM),
        lambda: SurfacePoints.read(file, crs=UTM),
        lambda: read_track(file, CRS(UTM)),
    ):
        assert refused(read) or name in ANSWERS
    assert found == []


@pytest.mark.parametrize(
    "crs",
    [
        "+proj=utm +zone=8 +nadgrids={url}/x.gsb",
        "+proj=utm +zone=8 +nadgrids={canary}",
        "+init={canary}:x",
        "{url}/crs",
        "{canary}",
    ],
)
def test_no_crs_of_a_point_file_leads_elsewhere(
    crs: str, tmp_path: Path, contacts: tuple[str, list[bytes]]
) -> None:
    url, found = contacts
    header = "ply\nformat ascii 1.0\ncomment crs {}\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\nend_header\n1 2 3\n"

    def write(folder: Path, places: Places) -> Path:
        (folder / "a.ply").write_text(header.format(crs.format(url=places.url, canary=places.canary)))
        return folder / "a.ply"

    assert refused(lambda: SurfacePoints.read(bait(write, tmp_path, url)))
    assert found == []


@pytest.mark.parametrize("name", ["terrain", "area"])
def test_no_mission_leads_elsewhere(name: str, tmp_path: Path, contacts: tuple[str, list[bytes]]) -> None:
    url, found = contacts
    tif(tmp_path / "dem.tif")
    (tmp_path / "terrain.tif").write_text(wms(url))
    (tmp_path / "area.geojson").write_text(ogr_vrt(Places(url, tmp_path)))
    dem = "terrain.tif" if name == "terrain" else "dem.tif"
    (tmp_path / "m.toml").write_text(
        f'schema_version = 1\nname = "m"\n[terrain]\nsource = "dem"\nfile = "{dem}"\n[satellite]\ncell_m = 50.0\n'
        '[planner]\npattern = "lawnmower"\nswaths = 2\n[area]\nfile = "area.geojson"\n'
    )
    assert refused(lambda: open_run(read_mission(tmp_path / "m.toml"), tmp_path / "runs"))
    assert found == []


def test_arrays_are_never_unpickled(tmp_path: Path) -> None:
    from survey.io.arrays_file import read_arrays

    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.system, (f"touch {tmp_path / 'ran'}",)

    np.savez(tmp_path / "a.npz", facts=np.array([Bomb()], dtype=object))
    (tmp_path / "ran").unlink(missing_ok=True)
    assert refused(lambda: read_arrays(tmp_path / "a.npz", "x"))
    assert not (tmp_path / "ran").exists()


def test_the_vectors_are_many() -> None:
    assert len(RASTERS) + len(VECTORS) >= 20


_TRANSFORMED = """
import numpy as np
import rasterio.warp
from pyproj import CRS
from survey.core.crs.transformation import transformed

transformed(np.array([[-100.0, 40.0]]), "EPSG:4267", CRS("EPSG:32614"), "the test")
rasterio.warp.transform("EPSG:4267", "EPSG:32614", [-100.0], [40.0])
"""


@pytest.mark.parametrize("allowed", [False, True])
def test_a_crs_that_needs_a_grid_downloads_none_unless_it_is_allowed(tmp_path, contacts, allowed):
    url, found = contacts
    environment = {
        **os.environ,
        "PROJ_NETWORK": "ON",
        "PROJ_NETWORK_ENDPOINT": url,
        "PROJ_USER_WRITABLE_DIRECTORY": str(tmp_path),
        "FIRNLINE_PROJ_NETWORK": "ON" if allowed else "",
    }
    subprocess.run(
        [sys.executable, "-c", _TRANSFORMED], env=environment, check=not allowed, capture_output=True
    )
    assert bool(found) == allowed
