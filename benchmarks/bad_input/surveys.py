"""Points of surveyors and their heights: feet, systems of heights, contradictions, tables without a header, errors not stated."""

from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import rasterio
import shapely
from laspy.vlrs.known import GeoKeyDirectoryVlr

from benchmarks.bad_input.case import Case, Prepare, both, text
from benchmarks.bad_input.good import SOUTH, UTM, WEST, hills, raster, write_raster

FOOT_M = {"ft": 0.3048, "us-ft": 1200.0 / 3937.0}
_UNIT_KEYS = {"m": 9001, "ft": 9002, "us-ft": 9003}
_NAVD88_FEET = 6360
BASE_M = 310.0


def terrain(n: int = 12) -> np.ndarray:
    """Return points (n², 3) [m] of gentle ground over the site."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(n) * 12.0 + 5.0, np.arange(n) * 12.0 + 5.0))
    return np.column_stack([WEST + x, SOUTH + y, BASE_M + 0.05 * x + 2.0 * np.sin(y / 30.0)])


def heights_are(folder: Path, _: str) -> str:
    """Return what is wrong with the heights of the map in ``out``, which are those of `terrain` in metres."""
    with rasterio.open(folder / "out" / "dem.tif") as source:
        mean = source.read(1, masked=True)
    low, high = float(mean.min()), float(mean.max())
    truth = terrain()[:, 2]
    fine = truth.min() - 3.0 < low and high < truth.max() + 3.0
    return (
        ""
        if fine
        else f"heights of {low:.0f} to {high:.0f} m, and {truth.min():.0f} to {truth.max():.0f} m were measured"
    )


def las(name: str, key: int, value: int, factor: float) -> Prepare:
    """Return a preparation that writes LAS with heights of a unit that one GeoKey states."""

    def prepare(folder: Path) -> None:
        keys = {1024: 1, 3072: 32608, key: value}
        directory = GeoKeyDirectoryVlr()
        rows = [(k, 0, 1, v) for k, v in sorted(keys.items())]
        body = np.array([(1, 1, 0, len(rows)), *rows], dtype="<u2").tobytes()
        directory.parse_record_data(body)
        header = laspy.LasHeader(version="1.2", point_format=1)
        header.scales, header.offsets = [0.001] * 3, [WEST, SOUTH, 0.0]
        header.vlrs.append(directory)
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = (terrain() / [1.0, 1.0, factor]).T
        cloud.write(folder / name)

    return prepare


def survey_cases() -> list[Case]:
    """Return points whose heights, errors or columns readers mistake."""
    return [
        *_las_cases(),
        *_feet_cases(),
        *_unit_cases(),
        *_datum_cases(),
        *_conflict_cases(),
        *_table_cases(),
        *_sigma_cases(),
    ]


def _reconstruct(source: str, *more: str) -> list[str]:
    return ["reconstruct", source, "--grid", "15", "-q", "-o", "out", *more]


def _las_cases() -> list[Case]:
    stated: dict[str, tuple[int, int, float]] = {
        f"key 4099 {unit}": (4099, key, FOOT_M.get(unit, 1.0)) for unit, key in _UNIT_KEYS.items()
    }
    stated["key 4096 NAVD88 in US feet"] = (4096, _NAVD88_FEET, FOOT_M["us-ft"])
    stated["key 4096 NAVD88 in metres"] = (4096, 5703, 1.0)
    stated["key 4096 NAVD88 in feet"] = (4096, 8228, FOOT_M["ft"])
    cases = []
    for what, (key, value, factor) in stated.items():
        for name in ("heights.las", "heights.laz"):
            write = las(name, key, value, factor)
            cases.append(
                Case(
                    f"surveys: {what} in {name} · reconstruct",
                    write,
                    _reconstruct(name, "--sigma", "0.1"),
                    True,
                    heights_are,
                )
            )
        tiles = both(las("metres.las", 4099, 9001, 1.0), las("heights.las", key, value, factor))
        args = [
            "reconstruct",
            "metres.las",
            "heights.las",
            "--tiles",
            "--sigma",
            "0.1",
            "--grid",
            "2",
            "--workers",
            "1",
            "-q",
            "-o",
            "out",
        ]
        cases.append(
            Case(f"surveys: {what} beside metres · reconstruct --tiles", tiles, args, True, _tiles_are_right)
        )
    return cases


def _tiles_are_right(folder: Path, _: str) -> str:
    with rasterio.open(folder / "out" / "dem.vrt") as source:
        mean = source.read(1, masked=True)
    low, high, truth = float(mean.min()), float(mean.max()), terrain()[:, 2]
    return (
        ""
        if truth.min() - 5.0 < low and high < truth.max() + 5.0
        else f"heights of {low:.0f} to {high:.0f} m"
    )


def _rows(points: np.ndarray, header: str, separator: str = ",") -> str:
    lines = [separator.join(f"{value:.4f}" for value in row) for row in points]
    return "\n".join([header.replace(",", separator), *lines, ""])


def _feet_cases() -> list[Case]:
    """Return tables whose header states feet for heights alone, or a CRS in feet."""
    names = {
        "Elevation (ft)": "ft", "Height [ft]": "ft", "z_ft": "ft", "elev_usft": "us-ft", "Elevation (US ft)": "us-ft",
        "Elevation (ftUS)": "us-ft", "Ortho Height (US survey feet)": "us-ft", "Elev_FT": "ft",
    }  # fmt: skip
    cases = []
    for name, unit in names.items():
        table = terrain() / [1.0, 1.0, FOOT_M[unit]]
        content = text("p.csv", _rows(table, f"x_m,y_m,{name}"))
        cases.append(
            Case(
                f"surveys: column {name} · reconstruct",
                content,
                _reconstruct("p.csv", "--crs", UTM, "--sigma", "0.1"),
                True,
                heights_are,
            )
        )
    feet = terrain() / FOOT_M["us-ft"]
    plain = text("p.csv", _rows(terrain() / [1.0, 1.0, FOOT_M["us-ft"]], "x_m,y_m,z_m"))
    compound = Case(
        "surveys: EPSG:32608+6360 · reconstruct",
        plain,
        _reconstruct("p.csv", "--crs", "EPSG:32608+6360", "--sigma", "0.1"),
        True,
        heights_are,
    )
    state_plane = text("p.csv", _rows(feet - [feet[0, 0] - 980_000.0, feet[0, 1] - 200_000.0, 0.0], "x,y,z"))
    planar = [
        Case(
            f"surveys: {crs} · reconstruct",
            state_plane,
            _reconstruct("p.csv", "--crs", crs, "--sigma", "0.1"),
            True,
            heights_are,
        )
        for crs in ("EPSG:2263+6360", "EPSG:2263+8228")
    ]
    return [*cases, compound, *planar]


def _unit_cases() -> list[Case]:
    cases = []
    for unit, factor in {"m": 1.0, **FOOT_M}.items():
        csv = text("p.csv", _rows(terrain() / [1.0, 1.0, factor], "x_m,y_m,z"))
        args = _reconstruct("p.csv", "--crs", UTM, "--sigma", "0.1", "--units", unit)
        cases.append(Case(f"surveys: --units {unit} · reconstruct", csv, args, True, heights_are))

    def contradicts(folder: Path) -> None:
        (folder / "p.csv").write_text(_rows(terrain(), "x_m,y_m,Elevation (ft)"))

    args = _reconstruct("p.csv", "--crs", UTM, "--sigma", "0.1", "--units", "m")
    unknown = _reconstruct("p.csv", "--crs", UTM, "--sigma", "0.1", "--units", "furlong")
    return [
        *cases,
        Case(
            "surveys: --units against the column · reconstruct",
            contradicts,
            args,
            True,
            lambda _, printed: "" if "not used" in printed else "nothing says that --units is not used",
            ("--units", "ft"),
        ),
        Case(
            "surveys: --units furlong · reconstruct",
            contradicts,
            unknown,
            False,
            None,
            ("furlong", "m|ft", "us-ft"),
        ),
    ]


_UNKNOWN_GEOID = (
    'COMPD_CS["a",PROJCS["WGS 84 / UTM zone 8N",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],'
    'PARAMETER["central_meridian",-135],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],'
    'PARAMETER["false_northing",0],UNIT["metre",1]],VERT_CS["{name}",VERT_DATUM["{name}",2005],UNIT["metre",1],AXIS["Up",UP]]]'
)


def _datum_cases() -> list[Case]:
    """Return maps of two systems of heights: what differs by metres is refused or said."""
    kinds = {
        "EGM96": "EPSG:32608+5773", "EGM2008": "EPSG:32608+3855", "NAVD88": "EPSG:32608+5703",
        "an unknown geoid": _UNKNOWN_GEOID.format(name="unknown"), "a geoid of its own": _UNKNOWN_GEOID.format(name="Geoid A"),
        "another of its own": _UNKNOWN_GEOID.format(name="Geoid B"), "none": UTM,
    }  # fmt: skip
    pairs = [
        ("EGM96", "EGM2008"), ("EGM96", "NAVD88"), ("a geoid of its own", "another of its own"), ("an unknown geoid", "EGM96"),
        ("none", "EGM2008"), ("none", "an unknown geoid"),
    ]  # fmt: skip

    def said(_: Path, printed: str) -> str:
        return (
            ""
            if "datum" in printed or "height" in printed or "geoid" in printed.lower()
            else "nothing is said of the heights"
        )

    def both_maps(first: str, second: str) -> Prepare:
        def prepare(folder: Path) -> None:
            write_raster(folder / "later.tif", hills(), crs=kinds[first])
            write_raster(folder / "earlier.tif", hills(), crs=kinds[second])
            shape = shapely.to_wkb(shapely.box(WEST + 30.0, SOUTH + 30.0, WEST + 90.0, SOUTH + 90.0))
            pyogrio.raw.write(
                folder / "o.gpkg",
                np.array([shape], dtype=object),
                field_data=[],
                fields=[],
                geometry_type="Polygon",
                crs=UTM,
            )

        return prepare

    args = {
        "change": ["change", "later.tif", "earlier.tif", "--outline", "o.gpkg", "-o", "out"],
        "score --truth": ["score", "later.tif", "--truth", "earlier.tif"],
    }
    return [
        Case(f"surveys: heights of {a} against {b} · {command}", both_maps(a, b), words, True, said)
        for a, b in pairs
        for command, words in args.items()
    ]  # fmt: skip


def _conflict_cases() -> list[Case]:
    """Return points whose heights contradict one another at one place: named, or an error that holds their scatter."""
    cases = []
    for apart_m in (0.4, 1.0, 5.0):
        grid = terrain()
        again = grid.copy()
        again[:, 2] += np.where(np.arange(len(again)) % 2, apart_m, -apart_m)
        table = np.column_stack([np.vstack([grid, again]), np.full(2 * len(grid), 0.02)])

        def right(folder: Path, printed: str, apart_m: float = apart_m) -> str:
            with rasterio.open(folder / "out" / "dem.tif") as source:
                sigma = source.read(2, masked=True)
            said = any(word in printed for word in ("contradict", "differ", "scatter", "disagree"))
            return (
                ""
                if said or float(sigma.min()) > 0.25 * apart_m
                else f"σ {float(sigma.min()):.3f} m beside heights {2 * apart_m:g} m apart"
            )

        for method in ("gp", "tin", "dense"):
            args = _reconstruct("p.csv", "--crs", UTM, "--method", method)
            cases.append(
                Case(
                    f"surveys: heights {apart_m:g} m apart at one place · {method}",
                    text("p.csv", _rows(table, "x_m,y_m,z_m,sigma_z_m")),
                    args,
                    True,
                    right,
                )
            )
    return cases


def _table_cases() -> list[Case]:
    """Return tables of total stations and receivers without a header, in all orders and separators."""
    grid = terrain()
    numbers = np.arange(1, len(grid) + 1)
    orders = {
        "pnezd": [f"{k},{y:.3f},{x:.3f},{z:.3f},GRND" for k, (x, y, z) in zip(numbers, grid, strict=True)],
        "penz": [f"{k},{x:.3f},{y:.3f},{z:.3f}" for k, (x, y, z) in zip(numbers, grid, strict=True)],
        "xyz": [f"{x:.3f},{y:.3f},{z:.3f}" for x, y, z in grid],
    }
    separators = {"commas": ",", "blanks": " ", "tabs": "\t", "semicolons": ";"}
    cases = []
    for order, rows in orders.items():
        for called, separator in separators.items():
            content = "\n".join([row.replace(",", separator) for row in rows] + [""])
            known = _reconstruct("p.txt", "--crs", UTM, "--sigma", "0.1", "--format", order)
            unknown = _reconstruct("p.txt", "--crs", UTM, "--sigma", "0.1")
            cases.append(
                Case(
                    f"surveys: {order} with {called} · --format",
                    text("p.txt", content),
                    known,
                    True,
                    heights_are,
                )
            )
            cases.append(
                Case(
                    f"surveys: {order} with {called} · no option",
                    text("p.txt", content),
                    unknown,
                    True,
                    heights_are,
                    ("--format", "--columns"),
                )
            )
    names = {
        "RL": "E,N,RL",
        "Ortho Ht": "Easting,Northing,Ortho Ht",
        "Elev": "East,North,Elev",
        "Reduced Level": "Easting (m),Northing (m),Reduced Level",
    }
    for name, header in names.items():
        args = _reconstruct("p.csv", "--crs", UTM, "--sigma", "0.1")
        cases.append(
            Case(
                f"surveys: column {name} · reconstruct",
                text("p.csv", _rows(grid, header)),
                args,
                True,
                heights_are,
                ("--columns",),
            )
        )
    by_number = _reconstruct("p.txt", "--crs", UTM, "--sigma", "0.1", "--columns", "x=3,y=2,z=4")
    pnezd = text("p.txt", "\n".join([*orders["pnezd"], ""]))
    return [
        *cases,
        Case("surveys: pnezd by numbers of columns · --columns", pnezd, by_number, True, heights_are),
    ]


def _sigma_cases() -> list[Case]:
    """Return points that state no error, in every format: the refusal names the option."""
    grid = terrain()

    def vector(name: str) -> Prepare:
        def prepare(folder: Path) -> None:
            shapes = np.array(
                [shapely.to_wkb(point, output_dimension=3) for point in shapely.points(grid)], dtype=object
            )
            pyogrio.raw.write(
                folder / name, shapes, field_data=[], fields=[], geometry_type="Point Z", crs=UTM
            )

        return prepare

    ply = "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nend_header\n{}\n"
    body = "\n".join(" ".join(map(str, row)) for row in grid)
    files: dict[str, tuple[Prepare, Sequence[str]]] = {
        "p.csv": (text("p.csv", _rows(grid, "x_m,y_m,z_m")), ("--crs", UTM)),
        "p.txt": (text("p.txt", _rows(grid, "Easting,Northing,Elevation", "\t")), ("--crs", UTM)),
        "p.xyz": (
            text("p.xyz", "\n".join(" ".join(f"{v:.3f}" for v in row) for row in grid) + "\n"),
            ("--crs", UTM),
        ),
        "p.gpkg": (vector("p.gpkg"), ()),
        "p.shp": (vector("p.shp"), ()),
        "p.fgb": (vector("p.fgb"), ()),
        "p.las": (las("p.las", 4099, 9001, 1.0), ()),
        "p.ply": (text("p.ply", ply.format(len(grid), body)), ("--crs", UTM)),
    }
    return [
        Case(f"surveys: no error in {name} · reconstruct", write, _reconstruct(name, *more), False, None, ("--sigma",))
        for name, (write, more) in files.items()
    ] + [
        Case(
            "surveys: no error of checkpoints · score",
            both(raster("map.tif"), text("c.csv", _rows(grid[:30], "x_m,y_m,z_m"))),
            ["score", "map.tif", "--checkpoints", "c.csv", "-q"], True, None, ("--sigma",),
        )
    ]  # fmt: skip
