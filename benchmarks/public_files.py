"""Files of other programs that anyone can get: ``python -m benchmarks.public_files FOLDER``.

The files are tests of other packages: source archives of the Python index, unpacked in FOLDER (``evo-1.38.1``, ``gpxpy-1.6.2``,
``gpxo-0.3.0``, ``laspy-2.7.0``, ``pykml-0.2.0``, ``pynmea2-1.19.0``, ``pyshp-3.1.6``, ``rasterstats-0.21.0``), the folders
``tests`` of installed ones (``pyogrio``, ``scipy``, ``xarray``), and texts of the repositories of ArduPilot and QGroundControl,
placed in FOLDER as `ROWS` names them. None belongs to this project, and none is stored in it; the table has their checksums. A file
that is not there, or whose bytes are not those of the stored table, is left out.

Each file goes to the command that a user would take. Its result is judged by a reading of the file that uses no reader of this
project and none of the libraries that firnline reads that format with: headers unpacked byte by byte, XML and text split.
A refusal is right where that reading finds a reason, and it is one sentence.
"""

import hashlib
import json
import re
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import rasterio

from benchmarks.writer import TABLES, Run, read_table

RESULT = TABLES / "public_files.json"
_LONGEST_S = 300.0

Judge = Callable[[Path, Path], str]
"""From the file and the folder of the result to what is wrong with the result, ``""`` where nothing is."""


class Row(NamedTuple):
    """A public file and what is right for it.

    `origin`: package or repository. `path`: in FOLDER. `args`: command line,
    where ``{}`` stands for the file, and ``out`` for the result. `reason`: why a refusal is right, with a word that it has to
    hold; ``""`` where the file has to be used. `judge`: of a result. `by`: what the judgement rests on.
    """

    origin: str
    path: str
    args: tuple[str, ...]
    by: str
    reason: str = ""
    judge: Judge | None = None


def _track_points(file: Path) -> list[tuple[float, float]]:
    """Return heights and Unix times of the track points of GPX; NaN where they lack one."""
    root = ElementTree.fromstring(file.read_bytes())
    found = []
    for point in (e for e in root.iter() if e.tag.endswith("trkpt")):
        kinds = {e.tag.rsplit("}", 1)[-1]: (e.text or "").strip() for e in point}
        time = kinds.get("time", "")
        when = datetime.fromisoformat(time).timestamp() if time else float("nan")
        found.append((float(kinds.get("ele") or "nan"), when))
    return found


def gpx_path(file: Path, out: Path) -> str:
    """Compare a path with the track points of GPX: their number without repeats, heights and times."""
    points = np.array(_track_points(file))
    path = np.loadtxt(out / "trajectory.tum", comments="#", ndmin=2)
    span_s = points[-1, 1] - points[0, 1]
    findings = {
        f"{len(path)} poses of {len(points)} points": not 0.9 * len(points) <= len(path) <= len(points),
        f"{path[-1, 0] - path[0, 0]:.0f} s of {span_s:.0f} s": abs(path[-1, 0] - path[0, 0] - span_s) > 1.0,
        "other heights": abs(np.median(path[:, 3]) - np.median(points[:, 0]))
        > 0.05 * np.ptp(points[:, 0]) + 0.01,
        "ground below an unknown antenna": (out / "landmarks.gpkg").exists(),
    }
    return next((words for words, is_so in findings.items() if is_so), "")


def poses_of_text(file: Path, out: Path) -> str:
    """Compare a track with lines of times and places: their number, the length of the way and the time."""
    rows = [
        line.split() for line in file.read_text().splitlines() if line.strip() and not line.startswith("#")
    ]
    given = np.array([[float(word) for word in row[:4]] for row in rows])
    found = np.loadtxt(out.with_suffix(".tum"), comments="#")
    lengths = [float(np.linalg.norm(np.diff(path[:, 1:4], axis=0), axis=1).sum()) for path in (given, found)]
    if len(given) != len(found):
        return f"{len(found)} poses of {len(given)}"
    return "" if np.isclose(*lengths, rtol=1e-6) and np.allclose(given[:, 0], found[:, 0]) else "another way"


def _las_header(file: Path) -> tuple[int, float, float]:
    """Return number, least and greatest height of the points of LAS in its own unit, from the bytes of the header."""
    raw = file.read_bytes()[:375]
    minor = raw[25]
    n = struct.unpack_from("<Q", raw, 247)[0] if minor >= 4 else struct.unpack_from("<I", raw, 107)[0]
    high, low = struct.unpack_from("<dd", raw, 211)
    return n, low, high


def heights_of_las(factor: float) -> Judge:
    """Return a judge of a map by the heights in the header of LAS, times a factor to metres."""

    def judge(file: Path, out: Path) -> str:
        _, low, high = _las_header(file)
        with rasterio.open(out / "dem.tif") as source:
            mean = source.read(1, masked=True)
        room = 0.05 * (high - low) * factor + 0.5
        fine = low * factor - room < float(mean.min()) and float(mean.max()) < high * factor + room
        return (
            ""
            if fine
            else f"{float(mean.min()):.1f} to {float(mean.max()):.1f} m, and {low * factor:.1f} to {high * factor:.1f} m were measured"
        )

    return judge


def _rings(file: Path) -> list[np.ndarray]:
    """Return the rings of the polygons of a shapefile from its bytes."""
    raw, at, rings = file.read_bytes(), 100, []
    while at + 12 <= len(raw):
        size = 2 * struct.unpack_from(">i", raw, at + 4)[0]
        body = raw[at + 8 : at + 8 + size]
        if len(body) == size and struct.unpack_from("<i", body)[0] in (5, 15, 25):
            n_parts, n_points = struct.unpack_from("<ii", body, 36)
            parts = [*struct.unpack_from(f"<{n_parts}i", body, 44), n_points]
            xy = np.frombuffer(body, "<f8", 2 * n_points, 44 + 4 * n_parts).reshape(-1, 2)
            rings += [xy[a:b] for a, b in pairwise(parts)]
        at += 8 + size
    return rings


def _signed_area(ring: np.ndarray) -> float:
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def area_of_shapefile(file: Path, out: Path) -> str:
    """Compare an area with the rings of a shapefile, whose shells turn clockwise; shells that overlap count once."""
    expected = -sum(_signed_area(ring) for ring in _rings(file))
    import pyogrio
    import shapely

    found = sum(shape.area for shape in shapely.from_wkb(pyogrio.raw.read(out.with_suffix(".gpkg"))[2]))
    return "" if 0.8 * expected <= found <= 1.001 * expected else f"{found:.0f} of {expected:.0f} units²"


def places_of_mission(file: Path, out: Path) -> str:
    """Compare a route with the items of a mission that have a place: each is a corner of the route, in order."""
    rows = [line.split() for line in file.read_text().splitlines()[2:] if line.strip()]
    places = np.array([(float(r[9]), float(r[8])) for r in rows if float(r[8]) or float(r[9])])
    content = json.loads(out.with_suffix(".geojson").read_text())
    corners = np.array(
        [
            xy[:2]
            for f in content["features"]
            if f["geometry"]["type"] == "LineString"
            for xy in f["geometry"]["coordinates"]
        ]
    )
    near = [int(np.argmin(np.abs(corners - place).sum(axis=1))) for place in places]
    if any(np.abs(corners[k] - place).max() > 1e-6 for k, place in zip(near, places, strict=True)):
        return "a place of the mission is not in the route"
    return "" if near == sorted(near) else "the places come in another order"


def raster_values(file: Path, out: Path) -> str:
    """Compare the numbers of an ASCII grid, as text, with the greatest and the least that GDAL states of the raster."""
    lines = out.with_suffix(".asc").read_text().splitlines()
    header = dict(line.split() for line in lines[:7] if line[:1].isalpha())
    mark = float(header.get("NODATA_value", header.get("nodata_value", "nan")))
    values = np.array([float(word) for line in lines if not line[:1].isalpha() for word in line.split()])
    with rasterio.open(file) as source:
        given = source.read(1, masked=True)
        shape = (source.height, source.width)
    found = values[values != mark]
    if (int(header["nrows"]), int(header["ncols"])) != shape or len(found) != given.count():
        return f"{len(found)} numbers of {given.count()}"
    if not len(found):
        return ""
    return "" if np.allclose([found.min(), found.max()], [given.min(), given.max()]) else "other numbers"


_LOCALIZE = ("localize", "{}", "-q", "-o", "out")
_AREA = ("export", "{}", "out.gpkg", "--as", "area")
_RASTER = ("export", "{}", "out.asc")
_MAP = ("reconstruct", "{}", "--sigma", "0.1", "--grid", "25", "-q", "-o", "out")
_MAP_HERE = (*_MAP, "--crs", "EPSG:32610")
_TRACK = ("export", "{}", "out.tum", "--as", "track", "--crs", "EPSG:32632")
_ROUTE = ("export", "{}", "out.geojson")
US_FOOT_M, FOOT_M = 1200.0 / 3937.0, 0.3048

_GPX = "gpxpy-1.6.2/test_files/"
_LAS = "laspy-2.7.0/tests/data/"
_EVO = "evo-1.38.1/test/data/"
_STATS = "rasterstats-0.21.0/tests/data/"
_PYSHP = "pyshp-3.1.6/tests/shapefiles/"
_OGR = "pyogrio/tests/fixtures/"
_KML = "pykml-0.2.0/src/pykml/test/testfiles/"


def _gpx_rows() -> list[Row]:
    used = (
        "around-visnjan-with-car",
        "cerknicko-jezero",
        "cerknicko-jezero-no-creator",
        "cerknicko-jezero-with-elevations-zero",
        "track-with-empty-segment",
        "track_with_speed",
    )
    refused = {
        "Mojstrovka": ("times of 1901 that repeat", "increase"),
        "cerknicko-jezero-without-elevations": ("no <ele>", "height"),
        "cerknicko-without-times": ("no <time>", "time"),
        "korita-zbevnica": ("no <time>", "time"),
        "track-with-extremes": ("no <time>", "time"),
        "first_and_last_elevation": ("points without <ele>", "height"),
        "route": ("a route and no track", "feature|track"),
        "gpx1.1_with_all_fields": ("one track point", "fix|two"),
        "unicode": ("way points and no track", "feature|track"),
    }  # fmt: skip
    rows = [
        Row("gpxpy", f"{_GPX}{name}.gpx", _LOCALIZE, "track points parsed as XML", judge=gpx_path)
        for name in used
    ]
    rows += [
        Row("gpxpy", f"{_GPX}{name}.gpx", _LOCALIZE, f"XML: {why}", reason=word)
        for name, (why, word) in refused.items()
    ]
    rows.append(
        Row("gpxo", "gpxo-0.3.0/ExampleTrack.gpx", _LOCALIZE, "track points parsed as XML", judge=gpx_path)
    )
    return rows


def _las_rows() -> list[Row]:
    header = "least and greatest height in the bytes of the header"
    feet = f"{header}, and the unit in its GeoKeys or WKT"
    used = {
        "autzen.las": ((*_MAP, "--units", "ft"), FOOT_M, feet),
        "autzen_trim.laz": ((*_MAP, "--units", "ft"), FOOT_M, feet),
        "test1_4.las": ((*_MAP, "--units", "us-ft"), US_FOOT_M, feet),
        "simple.copc.laz": (_MAP, US_FOOT_M, feet),
        "append-bug.laz": (_MAP, 1.0, header),
        "extra.laz": (_MAP_HERE, 1.0, header),
        "file_with_both_wkt_and_geotiff_vlrs.las": (_MAP, US_FOOT_M, feet),
    }
    refused = {
        "vegetation_1_3.las": (_MAP_HERE, "heights of −81 km in the header", "heights"),
        "simple1_4.las": (_MAP, "a CRS in degrees and places of 600 km", "degrees|transformed|coordinate"),
        "simple.las": (_MAP, "no CRS among the variable length records", "coordinate reference system"),
        "plane.laz": (_MAP, "GeoKeys of a projection without a code", "GeoKeys"),
        "autzen_geo_proj.las": (_MAP, "places in feet, and no unit of heights in its GeoKeys", "--units"),
    }  # fmt: skip
    rows = [
        Row("laspy", f"{_LAS}{name}", args, by, judge=heights_of_las(factor))
        for name, (args, factor, by) in used.items()
    ]
    return rows + [
        Row("laspy", f"{_LAS}{name}", args, by, reason=word) for name, (args, by, word) in refused.items()
    ]


def _shape_rows() -> list[Row]:
    rings = "area of the rings in the bytes of the .shp"
    used = [
        Row("rasterstats", f"{_STATS}{name}.shp", _AREA, rings, judge=area_of_shapefile)
        for name in ("polygons", "polygons_no_overlap", "polygons_partial_overlap")
    ]
    refused = [
        ("rasterstats", f"{_STATS}lines.shp", "lines (type 3)", "LineString|polygon"),
        ("rasterstats", f"{_STATS}points.shp", "points (type 1)", "polygon|Point"),
        ("rasterstats", f"{_STATS}points_noproj.shp", "no .prj", "coordinate reference system"),
        ("rasterstats", f"{_STATS}feature.geojson", "GeoJSON in degrees with places of 1,000 km", "Earth"),
        ("pyshp", f"{_PYSHP}blockgroups.shp", "no .prj", "coordinate reference system"),
        ("pyshp", f"{_PYSHP}latin1.shp", "no .shx", "shx|damaged"),
        ("pyogrio", f"{_OGR}curve.gpkg", "a curve and no polygon", "LineString|polygon|CompoundCurve"),
        ("pyogrio", f"{_OGR}line_zm.gpkg", "a line", "LineString|polygon"),
        ("pyogrio", f"{_OGR}naturalearth_lowres/naturalearth_lowres.shp", "all countries of the Earth", "outlines|transformed|Earth|select|simple"),
        ("pykml", f"{_KML}google_kml_reference/altitudemode_reference.kml", "a line and no polygon", "polygon|LineString"),
        ("pykml", f"{_KML}google_kml_tutorial/using_the_cdata_element.kml", "a point", "polygon"),
        ("pykml", f"{_KML}simple_file_with_comments.kml", "no geometry", "feature|polygon|damaged|layer|holds no"),
        ("pykml", f"{_KML}google_kml_developers_guide/complete_tour_example.kml", "a tour without features", "feature"),
    ]  # fmt: skip
    return used + [Row(origin, path, _AREA, by, reason=word) for origin, path, by, word in refused]


def _other_rows() -> list[Row]:
    text = "lines split as text"
    used = [
        Row("evo", f"{_EVO}georeferenced.tum", _TRACK, text, judge=poses_of_text),
        *(Row("evo", f"{_EVO}{name}", _TRACK, text, judge=poses_of_text) for name in ("freiburg1_xyz-groundtruth.txt", "fr2_desk_ORB.txt")),
        *(Row("rasterstats", f"{_STATS}{name}.tif", _RASTER, "numbers of the grid as text", judge=raster_values) for name in ("slope", "slope_nodata", "all_nodata")),
        Row("ArduPilot", "ardupilot/SplineTerrain.waypoints", _ROUTE, "items split as text", reason="82|SPLINE|TAKEOFF|22", judge=places_of_mission),
    ]  # fmt: skip
    refused = [
        ("evo", f"{_EVO}fr2_desk_groundtruth.txt", _TRACK, "times that repeat", "increase"),
        ("evo", f"{_EVO}V102.txt", _TRACK, "times that repeat", "increase"),
        ("evo", f"{_EVO}ROS_example.bag", _LOCALIZE, "topics of transforms and poses alone", "images"),
        ("evo", f"{_EVO}nav2_turtlebot.mcap", _LOCALIZE, "topics of transforms and poses alone", "images"),
        ("evo", f"{_EVO}KITTI_00_gt_times.txt", _TRACK, "times without poses", "numbers|column|time"),
        ("pynmea2", "pynmea2-1.19.0/examples/data.log", _LOCALIZE, "one GGA sentence", "one|1 fix|fix"),
        ("scipy", "scipy/io/tests/data/example_1.nc", _RASTER, "temperatures in degrees Celsius", "celsius"),
        ("xarray", "xarray/tests/data/bears.nc", _RASTER, "no grid", "damaged|raster|get it again"),
        ("ArduPilot", "ardupilot/LoiterTurns.waypoints", _ROUTE, "loiters at 0, 0, which means here", "0|here"),
        ("QGroundControl", "qgroundcontrol/ce_geofence_rd_2.plan", _ROUTE, "a fence and no mission item", "waypoint|item|mission"),
    ]  # fmt: skip
    return used + [Row(origin, path, args, by, reason=word) for origin, path, args, by, word in refused]


ROWS: Sequence[Row] = (*_gpx_rows(), *_las_rows(), *_shape_rows(), *_other_rows())


def outcome(row: Row, file: Path) -> tuple[str, str]:
    """Run the command of a row; return ``right``, ``refused`` or what is wrong, and the last words of the command."""
    with tempfile.TemporaryDirectory() as place:
        args = [str(file) if word == "{}" else word for word in row.args]
        done = subprocess.run(
            [sys.executable, "-m", "firnline", *args],
            cwd=place,
            capture_output=True,
            text=True,
            timeout=_LONGEST_S,
            check=False,
        )
        words = done.stderr.strip().splitlines()
        last = words[-1].replace(f"{file}", file.name) if words else ""
        if done.returncode == 0:
            if row.judge is None:
                return "wrong: accepted", last
            found = row.judge(file, Path(place) / "out")
            return (f"wrong: {found}" if found else "right"), last
        is_sentence = done.returncode in (2, 3, 4, 5) and "Traceback" not in done.stderr
        if not is_sentence:
            return f"wrong: exit {done.returncode}", last
        if not row.reason:
            return "wrong: refused", last
        return ("refused" if re.search(row.reason, last) else "wrong: refused for another reason"), last


def main() -> None:
    """Judge every file that is there, print and store the table."""
    folder = Path(sys.argv[1])
    run = Run.begin(main, RESULT)
    stored = read_table(RESULT).get("table", [])
    known = {entry["file"]: entry["sha256"] for entry in stored}
    table: list[dict[str, Any]] = []
    for row in ROWS:
        file = (folder / row.path).absolute()
        if not file.is_file():
            print(f"not there: {row.path}")
            continue
        sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
        if known.get(row.path, sha256) != sha256:
            print(f"other bytes: {row.path}")
            continue
        found, words = outcome(row, file)
        table.append(
            {
                "file": row.path, "origin": row.origin, "sha256": sha256, "command": " ".join(row.args).replace("{}", file.name),
                "outcome": found, "judged by": row.by, "words": words if found != "right" else "",
            }
        )  # fmt: skip
        print(f"{found:10} {row.path}  {words[:200] if found.startswith('wrong') else ''}", flush=True)
    n_wrong = sum(entry["outcome"].startswith("wrong") for entry in table)
    run.write({"files": len(table), "wrong": n_wrong, "table": table})
    print(f"{len(table)} files, {n_wrong} wrong")
    sys.exit(bool(n_wrong))


if __name__ == "__main__":
    main()
