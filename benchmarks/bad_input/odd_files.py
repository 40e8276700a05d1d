"""Odd files: encodings, axes, layers, marks of missing numbers, places that are no regular files."""

import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rasterio
import shapely
from affine import Affine

from benchmarks.bad_input.case import Case, Prepare, Right, both, text
from benchmarks.bad_input.good import (
    MISSION,
    SIDE_M,
    SOUTH,
    UTM,
    WEST,
    area,
    hills,
    points_text,
    polygon,
    raster,
    write_raster,
    write_shape,
)

Write = Callable[[Path], object]
_FIRST = points_text().splitlines()[1]
_HEIGHT = _FIRST.split(",")[2]
_SWAPPED = "x_m,y_m,z_m,sigma_z_m\n" + "\n".join(
    ",".join([*row.split(",")[1::-1], *row.split(",")[2:]]) for row in points_text().splitlines()[1:]
)


def _height(shown: str) -> str:
    return points_text().replace(_HEIGHT, shown, 1)


# Each with whether it can be used.
POINTS: dict[str, tuple[str | bytes, bool]] = {
    "byte order mark": (points_text().encode("utf-8-sig"), True),
    "UTF-16": (points_text().encode("utf-16"), True),
    "UTF-16 without a mark": (points_text().encode("utf-16-le"), False),
    "CRLF": (points_text().replace("\n", "\r\n"), True),
    "CR alone": (points_text().replace("\n", "\r"), True),
    "tabs": (points_text().replace(",", "\t"), True),
    "semicolons": (points_text().replace(",", ";"), True),
    "thousands separator": (points_text().replace(_FIRST, '"500,001.0",6700002.0,100.0,0.1'), True),
    "narrow spaces in numbers": (_height("1\u202f000"), True),
    "underscores in numbers": (_height("1_0_0.0"), False),
    "Arabic digits": (_height("١٠٠"), True),
    "Unicode minus": (_height("\u2212100"), False),
    "hexadecimal": (_height("0x64"), False),
    "Fortran exponent": (_height("1.0d2"), False),
    "unit behind the number": (_height("100 m"), False),
    "NA": (_height("NA"), False),
    "-9999": (_height("-9999"), False),
    "-32768": (_height("-32768"), False),
    "9999": (_height("9999.0"), False),
    "comment": ("# made by me\n" + points_text(), True),
    "blank lines": (points_text().replace("\n", "\n\n"), True),
    "trailing commas": (points_text().replace("\n", ",\n"), True),
    "header twice": (points_text() * 2, False),
    "heights in feet": (points_text().replace("z_m", "z_ft"), True),
    "units in the header": (points_text().replace("x_m,y_m,z_m", "x [m],y [m],z [m]"), True),
    "exchanged axes": (_SWAPPED + "\n", False),
    "exchanged degrees": ("lon,lat,height,sigma_z_m\n" + "60.4,-135.1,5,0.1\n" * 4, False),
    "latitude 95": ("lon,lat,height,sigma_z_m\n-135.1,95.0,5,0.1\n", False),
    "longitude 405": ("lon,lat,height,sigma_z_m\n405.0,60.4,5,0.1\n", False),
    "number of 400 digits": (_height("1" * 400), False),
}


def _with(values: np.ndarray | None = None, **profile: object) -> Write:
    return lambda path: write_raster(path, hills() if values is None else values, **profile)


def _marked(mark: float, dtype: str) -> Write:
    values = hills()
    values[20:25, 20:25] = mark
    return _with(values, dtype=dtype, nodata=None)


def _zipped(path: Path) -> None:
    write_raster(path.with_name("inner.tif"), hills())
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(path.with_name("inner.tif"), "dem.tif")


def _loop(path: Path) -> None:
    other = path.with_name("other" + path.suffix)
    path.symlink_to(other)
    other.symlink_to(path)


def _masked(path: Path) -> None:
    write_raster(path, hills(), nodata=None)
    with rasterio.open(path, "r+") as target:
        target.write_mask(np.zeros((50, 50), dtype=bool))


def _socket(path: Path) -> None:
    import socket

    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path.name)


RASTERS: dict[str, Write] = {
    "named pipe": os.mkfifo,
    "socket": _socket,
    "loop of links": _loop,
    "zip": _zipped,
    "65535 in uint16": _marked(65535, "uint16"),
    "-2147483648 in int32": _marked(-2147483648, "int32"),
    "9999 in float32": _marked(9999.0, "float32"),
    "turned by 90 degrees": _with(transform=Affine(0.0, 3.0, WEST, 3.0, 0.0, SOUTH)),
    "turned by 180 degrees": _with(transform=Affine(-3.0, 0.0, WEST + SIDE_M, 0.0, 3.0, SOUTH)),
    "east to west": _with(transform=Affine(-3.0, 0.0, WEST + SIDE_M, 0.0, -3.0, SOUTH + SIDE_M)),
    "sheared": _with(transform=Affine(3.0, 0.5, WEST, 0.0, -3.0, SOUTH + SIDE_M)),
    "longitude 225": _with(crs="EPSG:4326", transform=Affine(1e-4, 0.0, 225.0, 0.0, -1e-4, 60.5)),
    "geocentric CRS": _with(crs="EPSG:4978"),
    "heights in feet by the CRS": _with(crs="EPSG:32608+8228"),
    "depths by the CRS": _with(crs="EPSG:32608+5715"),
    "hidden by its mask": _masked,
}


_ASC = "ncols 3\nnrows 2\nxllcorner 500000\nyllcorner 6700000\ncellsize 10\nNODATA_value -9999\n"
ASCII: dict[str, str] = {
    "nan": _ASC + "1 2 nan\n4 5 6\n",
    "decimal commas": _ASC + "1,5 2 3\n4 5 6\n",
    "decimal comma in the header": _ASC.replace("10", "10,5") + "1 2 3\n4 5 6\n",
    "byte order mark": "\ufeff" + _ASC + "1 2 3\n4 5 6\n",
    "corner and centre mixed": _ASC.replace("xllcorner", "xllcenter") + "1 2 3\n4 5 6\n",
    "no northing": _ASC.replace("yllcorner 6700000\n", "") + "1 2 3\n4 5 6\n",
    "Arabic digits": _ASC + "1 2 ٣\n4 5 6\n",
    "negative cells": _ASC.replace("cellsize 10", "cellsize -10") + "1 2 3\n4 5 6\n",
    "number of 400 digits": _ASC + "1 2 " + "9" * 400 + "\n4 5 6\n",
    "oblong cells": _ASC.replace("cellsize 10", "dx 10\ndy 20") + "1 2 3\n4 5 6\n",
}


def _layers(path: Path) -> None:
    import pyogrio

    for name, west in (("a", WEST), ("b", WEST + 60.0)):
        shape = np.array([shapely.to_wkb(shapely.box(west, SOUTH, west + 50.0, SOUTH + 50.0))], dtype=object)
        pyogrio.raw.write(
            path,
            shape,
            field_data=[],
            fields=[],
            geometry_type="Polygon",
            crs=UTM,
            layer=name,
            append=name == "b",
        )


def _empty_layer(path: Path) -> None:
    import pyogrio

    nothing = np.array([], dtype=object)
    pyogrio.raw.write(path, nothing, field_data=[], fields=[], geometry_type="Polygon", crs=UTM, layer="area")


def _exchanged(path: Path) -> None:
    write_shape(path, shapely.transform(polygon(), lambda xy: xy[:, ::-1]))


def _features(*geometries: object) -> str:
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in geometries]
    system = {"type": "name", "properties": {"name": UTM}}
    return json.dumps({"type": "FeatureCollection", "crs": system, "features": features})


_RING = [list(corner) for corner in polygon().exterior.coords]
_POLYGON = {"type": "Polygon", "coordinates": [_RING]}
_GPX = '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">{}</gpx>'


def _area_files() -> dict[str, tuple[str, Prepare, bool]]:
    """Return odd areas: the file, what writes it, and whether it can be used."""
    collection = {"type": "GeometryCollection", "geometries": [_POLYGON]}
    words = {"type": "Polygon", "coordinates": [[[str(x), y] for x, y in _RING]]}
    texts = {
        "byte order mark": ("\ufeff" + _features(_POLYGON), True),
        "UTF-16": (_features(_POLYGON).encode("utf-16"), False),
        "lines of features": ("\n".join([_features(_POLYGON)] * 2), False),
        "no geometry": (_features(None), False),
        "no geometry in one of two": (_features(None, _POLYGON), False),
        "collection of geometries": (_features(collection), False),
        "coordinates of text": (_features(words), False),
        "ring that is not closed": (_features({"type": "Polygon", "coordinates": [_RING[:-1]]}), False),
        "one number per corner": (
            _features({"type": "Polygon", "coordinates": [[[x] for x, _ in _RING]]}),
            False,
        ),
        "integer of 400 digits": (
            _features(_POLYGON).replace(str(_RING[0][0]), "1" + "0" * 400),
            False,
        ),
    }
    found = {name: ("odd.geojson", text("odd.geojson", c), fine) for name, (c, fine) in texts.items()}
    made: dict[str, tuple[str, Write, bool]] = {
        "two layers": ("odd.gpkg", _layers, False),
        "empty layer": ("odd.gpkg", _empty_layer, False),
        "exchanged axes": ("odd.gpkg", _exchanged, False),
        "heights at its corners": (
            "odd.gpkg",
            lambda path: write_shape(path, shapely.force_3d(polygon(), 50.0)),
            True,
        ),
        "named pipe": ("odd.geojson", os.mkfifo, False),
        "loop of links": ("odd.gpkg", _loop, False),
        "no track": ("odd.gpx", lambda path: path.write_text(_GPX.format("")), False),
        "track without points": (
            "odd.gpx",
            lambda path: path.write_text(_GPX.format("<trk><trkseg></trkseg></trk>")),
            False,
        ),
        "KMZ without placemarks": ("odd.kmz", _zipped_kml, False),
    }
    return found | {name: (file, _writing(write, file), fine) for name, (file, write, fine) in made.items()}


def _zipped_kml(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("doc.kml", "<kml/>")


def _writing(write: Write, file: str) -> Prepare:
    return lambda folder: write(folder / file) and None


MISSIONS: dict[str, tuple[str | bytes, bool]] = {
    "byte order mark": (MISSION.encode("utf-8-sig"), True),
    "UTF-16": (MISSION.encode("utf-16"), False),
    "CRLF": (MISSION.replace("\n", "\r\n"), True),
    "integer of 400 digits": (MISSION.replace("swaths = 2", "swaths = 1" + "0" * 400), False),
    "integer of 5,000 digits": (MISSION.replace("swaths = 2", "swaths = " + "1" * 5000), False),
    "seed of 65 bits": (f"seed = {2**65}\n" + MISSION, False),
    "hexadecimal number": (MISSION.replace("swaths = 2", "swaths = 0x2"), True),
    "Arabic digits": (MISSION.replace("swaths = 2", "swaths = ٢"), False),
    "decimal comma": (MISSION.replace("150.0", "150,0"), False),
    "key twice": (MISSION + "swaths = 3\n", False),
    "date for a number": (MISSION.replace("150.0", "2026-01-01"), False),
    "yes for a number": (MISSION.replace("swaths = 2", "swaths = true"), False),
    "lattice of 1e-300 m": (
        MISSION + '[reconstruction]\nmethod = "field"\n[reconstruction.field]\nstep_m = 1e-300\n',
        False,
    ),
    "emap of 1e-9 m": (
        MISSION + '[reconstruction]\nmethod = "emap"\n[reconstruction.emap]\nstep_m = 1e-9\n',
        False,
    ),
    "carving of 1e-9 m": (
        'fidelity = "statistical"\n'
        + MISSION
        + '[reconstruction]\nmethod = "carving"\n[reconstruction.carving]\nlast_length_m = 1e-9\n',
        False,
    ),
    "fine ground of 1e-9 m": ('fidelity = "vision"\n' + MISSION + "[scenery]\nstep_m = 1e-9\n", False),
    "physics at 1e15 Hz": (
        'fidelity = "vision"\n' + MISSION + "[physics]\nrate_hz = 1000000000000000\n",
        False,
    ),
    "GPS at 1e15 Hz": (
        'fidelity = "vision"\n' + MISSION + "[instruments.gps]\nrate_hz = 1e15\n",
        False,
    ),
    "a million stakes": (MISSION + "[aids]\nstakes = 1000000\n", False),
}


def odd_cases() -> list[Case]:
    """Return odd files of every kind at the commands that read them."""
    return [*_point_cases(), *_raster_cases(), *_area_cases(), *_mission_cases(), *_output_cases()]


def _point_cases() -> list[Case]:
    uses = {
        "reconstruct": (both(), ["reconstruct", "odd.csv", "--crs", UTM, "--grid", "25", "-q"]),
        "score --checkpoints": (
            raster("map.tif"),
            ["score", "map.tif", "--checkpoints", "odd.csv", "--sigma", "0.02", "-q"],
        ),
    }
    return [
        Case(
            f"odd points {name} · {place}",
            both(beside, text("odd.csv", content)),
            args,
            fine,
            _map_of(name) if place == "reconstruct" else None,
        )
        for name, (content, fine) in POINTS.items()
        for place, (beside, args) in uses.items()
    ]


def _map_of(name: str) -> Right | None:
    """Return a check that a map has the heights of the points, 95 to 106 m; of one blunder, that it is left out."""
    factor = 0.3048 if name == "heights in feet" else 1.0

    def right(folder: Path, _: str) -> str:
        with rasterio.open(folder / "reconstruction" / "dem.tif") as source:
            mean = source.read(1, masked=True)
        low, high = float(mean.min()) / factor, float(mean.max()) / factor
        return "" if low > 90.0 and high < 110.0 else f"heights of {low:.0f} to {high:.0f} m"

    return right if name in _MAPPED else None


_MAPPED = {
    "byte order mark", "UTF-16", "CRLF", "CR alone", "tabs", "semicolons", "thousands separator", "blank lines", "trailing commas",
    "heights in feet", "comment", "units in the header", "Arabic digits",
}  # fmt: skip


def _checked(name: str, place: str) -> Right | None:
    """Return a check that heights in feet were converted, of the place that writes them."""

    def right(folder: Path, _: str) -> str:
        lines = (folder / "out.asc").read_text().splitlines()
        found = np.array([line.split() for line in lines if not line[:1].isalpha()], dtype=np.float64)
        return (
            ""
            if np.allclose(found, 0.3048 * hills(), atol=1e-3)
            else "heights that are not those in feet, in metres"
        )

    return right if (name, place) == ("heights in feet by the CRS", "export") else None


def _raster_cases() -> list[Case]:
    uses = {
        "plan --prior": (area, ["plan", "area.gpkg", "--prior", "odd.tif", "-q"]),
        "score --truth": (raster("map.tif"), ["score", "map.tif", "--truth", "odd.tif", "-q"]),
        "export": (both(), ["export", "odd.tif", "out.asc"]),
    }
    rasters = [
        Case(
            f"odd raster {name} · {place}",
            both(beside, _writing(write, "odd.tif")),
            args,
            (name == "hidden by its mask" and place == "export") or name == "heights in feet by the CRS",
            _checked(name, place),
        )
        for name, write in RASTERS.items()
        for place, (beside, args) in uses.items()
    ]
    grids = [
        Case(f"odd grid {name} · export", text("odd.asc", c), ["export", "odd.asc", "out.tif", "--crs", UTM])
        for name, c in ASCII.items()
    ]
    return rasters + grids


def _area_cases() -> list[Case]:
    return [
        Case(
            f"odd area {name} · {command[0]}",
            both(both(raster("good.tif"), raster("map.tif", 0.1)), write),
            command,
            fine,
        )
        for name, (file, write, fine) in _area_files().items()
        for command in (
            ["plan", file, "-q"],
            ["score", "map.tif", "--truth", "good.tif", "--area", file, "-q"],
            ["export", file, "out.gpkg", "--as", "area"],
        )
    ]


def _mission_cases() -> list[Case]:
    run = ["run", "m.toml", "--runs", "runs", "--until", "plan", "-q"]
    require = ["plan", "m.toml", "--require", "class-3", "-q"]
    missions = [
        Case(f"odd mission {name} · run", text("m.toml", content), run, fine)
        for name, (content, fine) in MISSIONS.items()
    ]
    large = MISSION.replace("step_m = 3.0", "step_m = 0.000001")
    return [*missions, Case("odd mission of 1e-6 m · plan --require", text("m.toml", large), require)]


def _output_cases() -> list[Case]:
    """Return outputs that are a loop of links, a pipe, or a folder in place of a file."""
    outputs: dict[str, Write] = {"loop of links": _loop, "named pipe": os.mkfifo, "folder": Path.mkdir}
    plan = ["plan", "area.gpkg", "-q", "-o", "out.geojson"]
    export = ["export", "good.tif", "out.tif"]
    return [
        Case(
            f"odd output {name} · {' '.join([command[0], *force])}",
            both(area, raster("good.tif"), _writing(write, command[-1])),
            [*command, *force],
            bool(force) and name != "folder",
        )
        for name, write in outputs.items()
        for command in (plan, export)
        for force in ([], ["--force"])
    ]
