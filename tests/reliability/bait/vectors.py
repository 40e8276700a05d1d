"""Vector files that lead to an address or to another file."""

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import shapely
from pyproj import CRS

from survey.io.vector import write_features
from tests.reliability.bait.places import UTM, Bait, Places, text_bait

VECTORS: dict[str, Bait] = {}


def text(name: str, file: str, content: Callable[[Places], str]) -> None:
    VECTORS[name] = text_bait(file, content)


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
    text(f"ogr_vrt_as_{ending}", f"a.{ending}", ogr_vrt)
for ending in ("geojson", "kml"):
    text(
        f"wfs_as_{ending}",
        f"a.{ending}",
        lambda p: f"<OGRWFSDataSource><URL>{p.url}/wfs</URL></OGRWFSDataSource>",
    )
text("pipeline_as_geojson", "a.geojson", pipeline)
text("pipeline_as_json", "a.json", pipeline)
text(
    "linked_crs",
    "a.geojson",
    lambda p: geojson({"type": "link", "properties": {"href": f"{p.url}/c", "type": "ogcwkt"}}),
)
text(
    "linked_crs_with_escapes",
    "a.geojson",
    lambda p: geojson({"type": "link", "properties": {"href": f"{p.url}/c"}}).replace('"crs"', '"\\u0063rs"'),
)
text(
    "crs_by_address",
    "a.geojson",
    lambda p: geojson({"type": "url", "properties": {"url": f"{p.url}/c"}}),
)
text(
    "crs_named_by_address",
    "a.geojson",
    lambda p: geojson({"type": "name", "properties": {"name": f"{p.url}/c"}}),
)
text(
    "crs_named_by_path",
    "a.geojson",
    lambda p: geojson({"type": "name", "properties": {"name": str(p.canary)}}),
)
text(
    "network_link",
    "a.kml",
    lambda p: kml(p, f"<NetworkLink><Link><href>{p.url}/n.kml</href></Link></NetworkLink>"),
)
text(
    "entity_in_kml",
    "a.kml",
    lambda p: kml(
        p,
        "<Placemark><name>&e;</name><Point><coordinates>1,2</coordinates></Point></Placemark>",
        f'<!DOCTYPE k [<!ENTITY e SYSTEM "{p.url}/e">]>',
    ),
)
text(
    "entity_in_gpx",
    "a.gpx",
    lambda p: (
        f'<!DOCTYPE k [<!ENTITY e SYSTEM "{p.canary}">]><gpx version="1.1"><wpt lat="1" lon="2"><name>&e;</name></wpt></gpx>'
    ),
)
text(
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
