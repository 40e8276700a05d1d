"""Outlines of other programs: holes and parts that readers lose, neighbours that touch, keys twice, many outlines in a file."""

import json
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from affine import Affine
from pyproj import Transformer

from benchmarks.bad_input.case import Case, Prepare, Right, both, text
from benchmarks.bad_input.good import UTM, hills, write_raster

EAST, NORTH, SIDE_M = 500_000.0, 6_700_000.0, 500.0
_TO_DEGREES = Transformer.from_crs(UTM, "EPSG:4326", always_xy=True)
_KML = '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'


def square(west: float, south: float, side_m: float) -> shapely.Polygon:
    """Return a square by its corner's distance from that of the site [m]."""
    return shapely.box(EAST + west, NORTH + south, EAST + west + side_m, NORTH + south + side_m)


SITE = square(0.0, 0.0, SIDE_M)
HOLES = [
    square(60.0, 60.0, 80.0),
    square(320.0, 70.0, 90.0),
    square(180.0, 300.0, 100.0),
    square(350.0, 350.0, 60.0),
]


def degrees(shape: shapely.Geometry) -> shapely.Geometry:
    """Return a shape of the site in degrees."""
    return shapely.transform(shape, lambda xy: np.column_stack(_TO_DEGREES.transform(*xy.T)))


def features(
    shapes: Sequence[shapely.Geometry], properties: Sequence[dict[str, object]] = (), crs: str | None = UTM
) -> str:
    """Return GeoJSON of shapes."""
    each = properties or [{}] * len(shapes)
    content: dict[str, object] = {"type": "FeatureCollection"}
    if crs is not None:
        content["crs"] = {"type": "name", "properties": {"name": crs}}
    content["features"] = [
        {"type": "Feature", "properties": p, "geometry": json.loads(shapely.to_geojson(shape))}
        for shape, p in zip(shapes, each, strict=True)
    ]
    return json.dumps(content)


def read_shapes(path: Path) -> list[shapely.Geometry]:
    """Read the shapes of a file by GDAL, in metres of the site."""
    meta, _, raw, _ = pyogrio.raw.read(path)
    shapes = list(shapely.from_wkb(raw))
    if "32608" in str(meta["crs"]):
        return shapes
    there = Transformer.from_crs(meta["crs"], UTM, always_xy=True)
    return [shapely.transform(s, lambda xy: np.column_stack(there.transform(*xy.T))) for s in shapes]


def area_is(expected: shapely.Geometry) -> Right:
    """Return a check that out.gpkg holds this ground, to 0.2 % of it."""

    def right(folder: Path, _: str) -> str:
        meta, _index, raw, columns = pyogrio.raw.read(folder / "out.gpkg")
        roles = dict(zip(meta["fields"], columns, strict=True)).get("role", ["area"] * len(raw))
        shapes = {role: [] for role in roles}
        for role, shape in zip(roles, shapely.from_wkb(raw), strict=True):
            shapes[role].append(shape)
        found = shapely.union_all(shapes["area"]).difference(shapely.union_all(shapes.get("no-go", [])))
        off = found.symmetric_difference(expected).area
        return "" if off < 2e-3 * expected.area else f"{off:.0f} m² differ of {expected.area:.0f}"

    return right


def avoids(holes: Sequence[shapely.Geometry]) -> Right:
    """Return a check that the route leaves holes out, but for a metre at their edges."""
    inner = shapely.union_all(holes).buffer(-1.0)

    def right(folder: Path, _: str) -> str:
        lines = [s for s in read_shapes(folder / "route.geojson") if s is not None and s.length > 0.0]
        inside = shapely.union_all(lines).intersection(inner).length
        if not lines:
            return "the route has no line"
        return "" if inside < 1.0 else f"{inside:.0f} m of the route lie in holes"

    return right


def _ring(ring: shapely.LinearRing) -> str:
    words = " ".join(f"{x:.9f},{y:.9f},0" for x, y in ring.coords)
    return f"<LinearRing><coordinates>{words}</coordinates></LinearRing>"


def google_earth(holes: Sequence[shapely.Polygon], *, in_multi: bool = False, in_folder: bool = False) -> str:
    """Return KML as Google Earth writes it: all holes in one ``innerBoundaryIs``."""
    outer = _ring(degrees(SITE).exterior)
    inner = "".join(_ring(degrees(hole).exterior) for hole in holes)
    body = f"<Polygon><outerBoundaryIs>{outer}</outerBoundaryIs><innerBoundaryIs>{inner}</innerBoundaryIs></Polygon>"
    body = f"<MultiGeometry>{body}</MultiGeometry>" if in_multi else body
    mark = f"<Placemark><name>site</name>{body}</Placemark>"
    return _KML.format(f"<Folder><name>f</name>{mark}</Folder>" if in_folder else mark)


def kmz(content: str) -> Prepare:
    def prepare(folder: Path) -> None:
        with zipfile.ZipFile(folder / "site.kmz", "w") as archive:
            archive.writestr("doc.kml", content)

    return prepare


def _written(name: str, shapes: Sequence[shapely.Geometry], kind: str = "Unknown") -> Prepare:
    """Return a preparation that writes shapes by GDAL, as they are."""

    def prepare(folder: Path) -> None:
        if name.endswith(".geojson"):
            (folder / name).write_text(features(shapes))
            return
        raw = np.array([shapely.to_wkb(shape) for shape in shapes], dtype=object)
        pyogrio.raw.write(folder / name, raw, field_data=[], fields=[], geometry_type=kind, crs=UTM)

    return prepare


def _commands(
    name: str, expected: shapely.Geometry, holes: Sequence[shapely.Geometry]
) -> dict[str, tuple[list[str], Right]]:
    return {
        "export": (["export", name, "out.gpkg", "--as", "area", "--crs", UTM], area_is(expected)),
        "plan": (["plan", name, "--crs", UTM, "--spacing", "40", "-q", "-o", "route.geojson"], avoids(holes)),
    }


def outline_cases() -> list[Case]:
    """Return outlines that readers of other programs' files lose parts of."""
    return [
        *_hole_cases(),
        *_nested_cases(),
        *_touching_cases(),
        *_twice_cases(),
        *_path_cases(),
        *_many_cases(),
    ]


def _hole_cases() -> list[Case]:
    cases = []
    for n in (2, 3, 4):
        holes = HOLES[:n]
        ground = SITE.difference(shapely.union_all(holes))
        containers: dict[str, tuple[str, Prepare]] = {
            "KML": ("site.kml", text("site.kml", google_earth(holes))),
            "KML in a MultiGeometry": ("site.kml", text("site.kml", google_earth(holes, in_multi=True))),
            "KML in a folder": ("site.kml", text("site.kml", google_earth(holes, in_folder=True))),
            "KMZ": ("site.kmz", kmz(google_earth(holes))),
        }
        cases += [
            Case(
                f"outlines: {n} holes in one innerBoundaryIs, {kind} · {command}", prepare, args, True, right
            )
            for kind, (name, prepare) in containers.items()
            for command, (args, right) in _commands(name, ground, holes).items()
        ]
    return cases


def _nested_cases() -> list[Case]:
    """Return parts inside parts of one shape: holes that lost their direction, or islands without a hole; refused, or a hole."""
    inner, island = square(200.0, 200.0, 100.0), square(230.0, 230.0, 40.0)
    apart = square(600.0, 0.0, 200.0)
    shapes: dict[str, tuple[list[shapely.Polygon], shapely.Geometry]] = {
        "one part in another": ([SITE, inner], SITE.difference(inner)),
        "the inner part first": ([inner, SITE], SITE.difference(inner)),
        "two parts in another": ([SITE, inner, HOLES[0]], SITE.difference(inner.union(HOLES[0]))),
        "a part in a part in a part": ([SITE, inner, island], SITE.difference(inner).union(island)),
        "beside a part that lies apart": ([SITE, inner, apart], SITE.difference(inner).union(apart)),
    }
    return [
        Case(
            f"outlines: {what}, {ending} · {command}",
            _written(f"site{ending}", [shapely.MultiPolygon(parts)], "MultiPolygon"),
            args,
            True,
            right,
        )
        for what, (parts, ground) in shapes.items()
        for ending in (".geojson", ".gpkg", ".fgb")
        for command, (args, right) in _commands(f"site{ending}", ground, [inner]).items()
    ]


def _touching_cases() -> list[Case]:
    """Return neighbours that touch: a corner more on one side, millimetres apart, cut by a border; one area, nothing left out."""
    west, east = square(0.0, 0.0, 300.0), square(300.0, 0.0, 300.0)
    xy = list(east.exterior.coords)
    with_corner = [
        shapely.segmentize(east, 150.0),
        shapely.Polygon([(x, y) for x, y in shapely.segmentize(east, 70.0).exterior.coords]),
        shapely.Polygon(xy[:-1] + [(EAST + 300.0, NORTH + 33.3), xy[-1]])
        if xy[0][0] == EAST + 300.0
        else east,
    ]
    pairs = {f"{k + 1} corners more": [west, other] for k, other in enumerate(with_corner)}
    pairs |= {
        f"{1e3 * gap_m:g} mm apart": [west, shapely.transform(east, lambda p, gap=gap_m: p + [gap, 0.0])]
        for gap_m in (0.0002, 0.001, 0.006)
    }
    pairs |= {
        f"{1e3 * lap_m:g} mm over one another": [
            west,
            shapely.transform(east, lambda p, lap=lap_m: p - [lap, 0.0]),
        ]
        for lap_m in (0.001, 0.006)
    }
    pairs["four about one corner"] = [square(x, y, 250.0) for x in (0.0, 250.0) for y in (0.0, 250.0)]

    def no_loss(folder: Path, printed: str) -> str:
        lines = shapely.union_all([s for s in read_shapes(folder / "route.geojson") if s is not None])
        if "cut off" in printed:
            return "ground of neighbours that touch is left out"
        width_m = lines.bounds[2] - lines.bounds[0]
        return "" if width_m > 400.0 else f"the route spans {width_m:.0f} m"

    in_degrees = {
        what: [degrees(s) for s in pairs[what]] for what in ("1 corners more", "2 corners more", "6 mm apart")
    }
    in_degrees |= {
        "with straight edges in degrees": [_cell(-135.0, 1), _cell(-134.99, 3)],
        "cut at 180°": [_cell(179.99, 1), _cell(-180.0, 1)],
    }
    return [
        *(
            Case(
                f"outlines: neighbours in degrees, {what} · plan",
                text("site.geojson", features(shapes, (), None)),
                ["plan", "site.geojson", "--spacing", "40", "-q", "-o", "route.geojson"],
                True,
                _whole_of(shapes),
            )
            for what, shapes in in_degrees.items()
        ),
        *(
            Case(
                f"outlines: neighbours, {what}, {ending} · plan",
                _written(f"site{ending}", shapes, "Polygon"),
                ["plan", f"site{ending}", "--crs", UTM, "--spacing", "40", "-q", "-o", "route.geojson"],
                True,
                no_loss,
            )
            for what, shapes in pairs.items()
            for ending in (".geojson", ".gpkg")
        ),
    ]


def _cell(west_deg: float, n: int) -> shapely.Polygon:
    """Return a cell of a hundredth of a degree with so many pieces in its western edge."""
    edge = [(west_deg, 60.405 - 0.005 * k / n) for k in range(n + 1)]
    return shapely.Polygon([*edge, (west_deg + 0.01, 60.4), (west_deg + 0.01, 60.405)])


def _whole_of(shapes: Sequence[shapely.Geometry]) -> Right:
    """Return a check that swaths lie on each of the shapes, which are in degrees, and nothing is cut off."""

    def right(folder: Path, printed: str) -> str:
        if "cut off" in printed:
            return "ground of neighbours that touch is left out"
        meta, _, raw, _ = pyogrio.raw.read(folder / "route.geojson")
        back = Transformer.from_crs(meta["crs"], "EPSG:4326", always_xy=True)
        line = shapely.transform(
            shapely.union_all(shapely.from_wkb(raw)), lambda p: np.column_stack(back.transform(*p.T))
        )
        if max(shape.bounds[2] for shape in shapes) > 179.0:  # both sides of the border count from 0
            line, *turned = (shapely.transform(s, lambda p: p % [360.0, 720.0]) for s in (line, *shapes[1:]))
            return (
                ""
                if all(line.intersects(s.buffer(-1e-4)) for s in (shapes[0], *turned))
                else "an outline has no swath"
            )
        missed = [k for k, shape in enumerate(shapes) if not line.intersects(shape.buffer(-1e-4))]
        return f"no swath lies in outline {missed[0] + 1}" if missed else ""

    return right


def _twice_cases() -> list[Case]:
    """Return files with a key given twice, whose second value would win in silence."""
    good = features([SITE])
    other = json.dumps(json.loads(shapely.to_geojson(square(9_000.0, 0.0, 500.0))))
    twice = {
        "geometry": good.replace('"geometry":', f'"geometry": {other}, "geometry":', 1),
        "coordinates": good.replace(
            '"coordinates":',
            f'"coordinates": {json.dumps(json.loads(other)["coordinates"])}, "coordinates":',
            1,
        ),
        "features": good.replace('"features":', '"features": [], "features":', 1),
        "type": good.replace('"type": "Polygon"', '"type": "Point", "type": "Polygon"', 1),
        "crs": good.replace(
            '"crs":', '"crs": {"type": "name", "properties": {"name": "EPSG:32633"}}, "crs":', 1
        ),
        "properties": good.replace(
            '"properties": {}', '"properties": {"role": "no-go"}, "properties": {}', 1
        ),
    }
    commands: dict[str, list[str]] = {
        "export": ["export", "site.geojson", "out.gpkg", "--as", "area"],
        "plan": ["plan", "site.geojson", "--spacing", "40", "-q", "-o", "route.geojson"],
    }
    return [
        Case(f"outlines: key {key} twice · {command}", text("site.geojson", content), args)
        for key, content in twice.items()
        for command, args in commands.items()
    ]


def _path_cases() -> list[Case]:
    """Return places with signs that GDAL takes for the marks of its own file systems and layers."""

    def placed(name: str, content: str) -> Prepare:
        def prepare(folder: Path) -> None:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(content)

        return prepare

    names = (
        "a!b.geojson",
        "what!/site.geojson",
        "a|b.geojson",
        "a#b.geojson",
        "a?b=c.geojson",
        "a b's.geojson",
        "ä,ö;ü.geojson",
    )
    kml = google_earth(HOLES[:1])
    cases = [
        Case(f"outlines: in {name} · {command}", placed(name, features([SITE])), args, True, right)
        for name in names
        for command, (args, right) in _commands(name, SITE, []).items()
    ]
    args, right = _commands("a!b.kml", SITE.difference(HOLES[0]), [])["export"]
    return [*cases, Case("outlines: in a!b.kml · export", placed("a!b.kml", kml), args, True, right)]


def _many_cases() -> list[Case]:
    """Return files with many outlines, as inventories of glaciers are: the list is named, one is chosen."""
    shapes = [square(700.0 * k, 0.0, SIDE_M) for k in range(12)]
    rows: list[dict[str, object]] = [
        {"RGIId": f"RGI60-01.{k:05d}", "Name": f"Glacier {k}", "Area": 0.25} for k in range(len(shapes))
    ]
    many = text("rgi.geojson", features(shapes, rows))
    plan = ["plan", "rgi.geojson", "--spacing", "60", "-q", "-o", "route.geojson"]

    def of_third(folder: Path, _: str) -> str:
        line = shapely.union_all([s for s in read_shapes(folder / "route.geojson") if s is not None])
        return "" if shapes[3].buffer(5.0).contains(line) else "the route leaves the outline that was chosen"

    def prior(folder: Path) -> None:
        write_raster(
            folder / "prior.tif",
            2700.0 + 0.5 * (hills(400) - 100.0) + np.arange(400.0)[:, None] / 4.0,
            transform=Affine(2.0, 0.0, EAST, 0.0, -2.0, NORTH + 650.0),
        )

    chosen = [*plan, "--select", "RGIId=RGI60-01.00003"]
    fine = _many_corners(41_000)
    return [
        Case("outlines: twelve of an inventory · plan", many, plan, False, None, ("--select",)),
        Case("outlines: one of an inventory by its number · plan", many, chosen, True, of_third),
        Case("outlines: one of an inventory by its name · plan", many, [*plan, "--select", "Name=Glacier 3"], True, of_third),
        Case("outlines: one that the inventory has not · plan", many, [*plan, "--select", "RGIId=RGI60-01.99999"], False, None, ("RGIId", "--select")),
        Case("outlines: a column that the inventory has not · plan", many, [*plan, "--select", "rgi_idd=1"], False, None, ("rgi_idd", "--select")),
        Case(
            "outlines: the tongue below a height · plan", both(text("site.geojson", features([SITE])), prior),
            ["plan", "site.geojson", "--prior", "prior.tif", "--below", "2750", "--spacing", "60", "-q", "-o", "route.geojson"], True,
            lambda folder, _: "" if shapely.union_all([s for s in read_shapes(folder / "route.geojson") if s is not None]).length > 10.0 else "no route",
        ),
        Case(
            "outlines: below all ground · plan", both(text("site.geojson", features([SITE])), prior),
            ["plan", "site.geojson", "--prior", "prior.tif", "--below", "100", "-q", "-o", "route.geojson"], False, None, ("--below",),
        ),
        Case(
            "outlines: below a height without a prior · plan", text("site.geojson", features([SITE])),
            ["plan", "site.geojson", "--below", "2750", "-q", "-o", "route.geojson"], False, None, ("--prior",),
        ),
        Case(
            "outlines: 41,000 corners · plan", text("fine.geojson", features([fine])),
            ["plan", "fine.geojson", "--spacing", "100", "-q", "-o", "route.geojson"], True, avoids([square(-400.0, -400.0, 100.0)]),
        ),
    ]  # fmt: skip


def _many_corners(n: int) -> shapely.Polygon:
    turn = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    radius = 240.0 + 2.0 * np.sin(400.0 * turn)
    return shapely.Polygon(
        np.column_stack([EAST + 250.0 + radius * np.cos(turn), NORTH + 250.0 + radius * np.sin(turn)])
    )
