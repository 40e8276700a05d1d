"""Bad areas and outlines at every place where a command reads one."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely

from benchmarks.bad_input.case import Case, both, text
from benchmarks.bad_input.good import DEM_MISSION, SOUTH, UTM, WEST, polygon, raster, write_shape

Write = Callable[[Path], None]
_SQUARE = [[WEST, SOUTH], [WEST + 150, SOUTH], [WEST + 150, SOUTH + 150], [WEST, SOUTH + 150], [WEST, SOUTH]]


def _shape(shape: shapely.Geometry, role: str = "area", crs: str = UTM) -> Write:
    return lambda path: write_shape(path, shape, role, crs)


def _raw(content: str | bytes) -> Write:
    raw = content.encode() if isinstance(content, str) else content
    return lambda path: path.write_bytes(raw) and None


def _cut(path: Path) -> None:
    write_shape(path, polygon())
    path.write_bytes(path.read_bytes()[:5000])


def _geojson(coordinates: object, crs: str | None = "EPSG:32608") -> Write:
    import json

    system = {} if crs is None else {"crs": {"type": "name", "properties": {"name": crs}}}
    content = {
        "type": "FeatureCollection",
        **system,
        "features": [
            {
                "type": "Feature",
                "properties": {"role": "area"},
                "geometry": {"type": "Polygon", "coordinates": [coordinates]},
            }
        ],
    }
    return _raw(json.dumps(content))


def _ring(n: int, radius_m: float) -> shapely.Polygon:
    turn = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return shapely.Polygon(np.column_stack([WEST + radius_m * np.cos(turn), SOUTH + radius_m * np.sin(turn)]))


_OGR_VRT = (
    '<OGRVRTDataSource><OGRVRTLayer name="area"><SrcDataSource>/vsicurl/http://127.0.0.1:9/a.geojson'
    "</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>"
)
# Each with the ending that its content asks for.
VECTORS: dict[str, tuple[str, Write]] = {
    "missing": (".gpkg", lambda _: None),
    "empty": (".gpkg", _raw(b"")),
    "text": (".gpkg", _raw("this is no area")),
    "cut": (".gpkg", _cut),
    "folder": (".gpkg", lambda path: path.mkdir()),
    "bowtie": (
        ".gpkg",
        _shape(
            shapely.Polygon([(WEST, SOUTH), (WEST + 99, SOUTH + 99), (WEST + 99, SOUTH), (WEST, SOUTH + 99)])
        ),
    ),
    "line": (".gpkg", _shape(shapely.LineString([(WEST, SOUTH), (WEST + 50, SOUTH + 50)]))),
    "point": (".gpkg", _shape(shapely.Point(WEST, SOUTH))),
    "no ground": (".gpkg", _shape(shapely.Polygon())),
    "a square millimetre": (
        ".gpkg",
        _shape(shapely.box(WEST + 50, SOUTH + 50, WEST + 50.001, SOUTH + 50.001)),
    ),
    "as large as a country": (".gpkg", _shape(shapely.box(WEST - 3e5, SOUTH - 3e6, WEST + 3e5, SOUTH + 2e6))),
    "elsewhere": (".gpkg", _shape(shapely.box(WEST + 9e4, SOUTH, WEST + 9e4 + 150, SOUTH + 150))),
    "beyond the projection": (".gpkg", _shape(shapely.box(1e9, 1e9, 1e9 + 100, 1e9 + 100))),
    "unknown role": (".gpkg", _shape(shapely.box(WEST, SOUTH, WEST + 9, SOUTH + 9), "nogo")),
    "nothing but no-go": (
        ".gpkg",
        _shape(shapely.box(WEST - 1, SOUTH - 1, WEST + 151, SOUTH + 151), "no-go"),
    ),
    "broken JSON": (".geojson", _raw('{"type": "FeatureCollection", "features": [')),
    "JSON of another kind": (".geojson", _raw('{"answer": 42}')),
    "no features": (".geojson", _raw('{"type": "FeatureCollection", "features": []}')),
    "NaN corner": (".geojson", _geojson([*_SQUARE[:2], [None, SOUTH], _SQUARE[0]])),
    "metres that claim to be degrees": (".geojson", _geojson(_SQUARE, None)),
    "unknown CRS": (".geojson", _geojson(_SQUARE, "EPSG:999999")),
    "linked CRS": (
        ".geojson",
        _raw(
            '{"type":"FeatureCollection","crs":{"type":"link","properties":{"href":"http://127.0.0.1:9/x"}},"features":[]}'
        ),
    ),
    "OGR VRT in a .geojson": (".geojson", _raw(_OGR_VRT)),
    "nested 20,000 deep": (".geojson", _raw("[" * 20_000 + "]" * 20_000)),
    "not UTF-8": (".geojson", _raw(b'{"type": "\xff\xfe"}')),
    "broken KML": (".kml", _raw("<kml><Placemark>")),
    "KML with an entity bomb": (
        ".kml",
        _raw(
            '<!DOCTYPE k [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">'
            '<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;"><!ENTITY d "&c;&c;&c;&c;&c;&c;&c;&c;">]><kml>&d;</kml>'
        ),
    ),
    "Shapefile without .shx": (".shp", _raw(b"\x00\x00\x27\x0a" + bytes(96))),
    "unknown ending": (".xyz", _raw("1 2 3")),
    "a million corners": (".gpkg", _shape(_ring(1_000_000, 60.0))),
}
_MAY_SUCCEED = {"a million corners", "as large as a country"}


def vector_cases() -> list[Case]:
    """Return every bad area at every place."""
    cases = []
    for wrong, (ending, write) in VECTORS.items():
        name = f"bad{ending}"
        uses = {
            "plan": (text("note", "x"), ["plan", name, "-q"]),
            "plan with a prior": (raster("good.tif"), ["plan", name, "--prior", "good.tif", "-q"]),
            "score --area": (
                both(raster("good.tif"), raster("map.tif", 0.1)),
                ["score", "map.tif", "--truth", "good.tif", "--area", name],
            ),
            "change --outline": (
                both(raster("good.tif"), raster("map.tif", 0.1)),
                ["change", "map.tif", "good.tif", "--outline", name],
            ),
            "run": (
                both(raster("dem.tif"), text("m.toml", DEM_MISSION + f'[area]\nfile = "{name}"\n')),
                ["run", "m.toml", "--runs", "runs", "--until", "plan", "-q"],
            ),
            "export": (text("note", "x"), ["export", name, "out.gpkg", "--as", "area"]),
        }
        for place, (beside, args) in uses.items():
            fine = wrong in _MAY_SUCCEED or _fine(wrong, place)

            def prepare(folder: Path, write: Write = write, name: str = name) -> None:
                write(folder / name)

            cases.append(Case(f"area {wrong} · {place}", both(beside, prepare), args, fine))
    return cases


def _fine(wrong: str, place: str) -> bool:
    """Return where an odd area can be used: roles count in plans alone, a place without a raster beside it is free."""
    if wrong in {"elsewhere", "beyond the projection", "a square millimetre"}:
        return place in {"plan", "export", "change --outline"}
    if wrong in {"unknown role", "nothing but no-go"}:
        return place in {"change --outline", "export", "score --area"}
    return wrong == "metres that claim to be degrees" and place == "export"
