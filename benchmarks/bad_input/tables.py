"""Bad point files, routes and trajectories at every place where a command reads one."""

from pathlib import Path

import numpy as np

from benchmarks.bad_input.case import Case, Prepare, both, text
from benchmarks.bad_input.good import UTM, area, points, points_text, raster

_ROWS = points_text().splitlines()
_HEADER, _FIRST = _ROWS[0], _ROWS[1]


def _csv(*rows: str) -> str:
    return "\n".join(rows) + "\n"


def _replaced(old: str, new: str) -> str:
    content = points_text()
    assert old in content
    return content.replace(old, new, 1)


POINTS: dict[str, str | bytes] = {
    "empty": b"",
    "header alone": _csv(_HEADER),
    "one point": _csv(_HEADER, _FIRST),
    "no header": _csv(*_ROWS[1:]),
    "cut off in a row": points_text()[:-12],
    "cut off in a number": points_text()[:-3],
    "missing column": _replaced("z_m,", "height_of_what,"),
    "duplicate column": _replaced("sigma_z_m", "z_m"),
    "one number too many": _replaced(_FIRST, _FIRST + ",7.0"),
    "one number too few": _replaced(_FIRST, ",".join(_FIRST.split(",")[:2])),
    "words for numbers": _replaced(_FIRST, "one,two,three,0.1"),
    "NaN height": _replaced(_FIRST.split(",")[2], "nan"),
    "infinite height": _replaced(_FIRST.split(",")[2], "inf"),
    "empty field": _replaced(_FIRST.split(",")[2], ""),
    "zero sigma": points_text().replace(",0.1\n", ",0.0\n"),
    "negative sigma": points_text().replace(",0.1\n", ",-0.1\n"),
    "decimal commas": points_text().replace(",", ";").replace(".", ","),
    "not UTF-8": points_text().encode() + b"\xff\xfe\n",
    "NUL bytes": points_text().encode() + bytes(50),
    "one line of 10 MB": b"x" * 10_000_000,
    "all in one place": _csv(_HEADER, *[_FIRST] * 20),
    "heights of 1e300": points_text().replace(",100", ",1e300"),
    "places of 1e300": points_text().replace("500", "1e300"),
    "formula": _replaced(_FIRST, "=1+1,2,3,0.1"),
}
_MAY_SUCCEED = {"all in one place", "duplicate column", "decimal commas"}
_BINARIES: dict[str, tuple[str, bytes]] = {
    "LAS of zeros": ("bad.las", b"LASF" + bytes(400)),
    "LAZ of text": ("bad.laz", b"this is no cloud"),
    "PLY that promises 1e12 points": (
        "bad.ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nproperty float x\n"
        b"property float y\nproperty float z\nend_header\n",
    ),
    "GeoPackage of zeros": ("bad.gpkg", b"SQLite format 3\x00" + bytes(4000)),
    "Parquet": ("bad.parquet", b"PAR1" + bytes(100) + b"PAR1"),
}


def _uses(name: str) -> dict[str, tuple[Prepare, list[str]]]:
    return {
        "reconstruct": (both(), ["reconstruct", name, "--crs", UTM, "--grid", "10", "-q"]),
        "reconstruct tin": (
            both(),
            ["reconstruct", name, "--crs", UTM, "--grid", "10", "--method", "tin", "-q"],
        ),
        "score --checkpoints": (
            raster("map.tif"),
            ["score", "map.tif", "--checkpoints", name, "--sigma", "0.02", "-q"],
        ),
        "score --control": (
            both(raster("map.tif"), points),
            ["score", "map.tif", "--checkpoints", "points.csv", "--control", name, "-q"],
        ),
        "export": (both(), ["export", name, "out.ply", "--as", "points", "--crs", UTM]),
        "plan --measured": (
            both(area, raster("dem.tif")),
            [
                "plan",
                "area.gpkg",
                "--prior",
                "dem.tif",
                "--require",
                "class-3",
                "--adaptive",
                "--driven",
                "route.geojson",
                "--measured",
                name,
                "-q",
            ],
        ),
    }


def _point_cases() -> list[Case]:
    files = {wrong: ("bad.csv", content) for wrong, content in POINTS.items()} | _BINARIES
    cases = []
    for wrong, (name, content) in files.items():
        for place, (beside, args) in _uses(name).items():
            fine = wrong in _MAY_SUCCEED or place == "export" or (wrong == "one point" and "score" in place)
            cases.append(Case(f"points {wrong} · {place}", both(beside, text(name, content)), args, fine))
    return cases


def _bomb(folder: Path) -> None:
    """Write a small .npz that unpacks to 20 GB."""
    import io
    import zipfile

    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (2_500_000_000,)}
    )
    with zipfile.ZipFile(folder / "bad.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xyz.npy", header.getvalue() + bytes(50_000_000))


def _pickled(folder: Path) -> None:
    np.savez(folder / "bad.npz", xyz=np.array([{"a": 1}], dtype=object), allow_pickle=True)


_SCANS: dict[str, Prepare] = {
    "npz bomb": _bomb,
    "npz of pickles": _pickled,
    "npz of text": text("bad.npz", "this is no archive"),
    "empty npz": text("bad.npz", b""),
    "missing": both(),
    "empty folder": lambda folder: (folder / "bad.npz").mkdir(),
    "npz without places": lambda folder: np.savez(folder / "bad.npz", other=np.zeros(3)),
    "npz with NaN": lambda folder: np.savez(folder / "bad.npz", xyz=np.full((9, 3), np.nan)),
    "npz of one point": lambda folder: np.savez(
        folder / "bad.npz", xyz=np.zeros((1, 3)), origins=np.ones((1, 3))
    ),
}


def _scan_cases() -> list[Case]:
    return [
        Case(
            f"scan {wrong} · {method}",
            prepare,
            ["reconstruct", "bad.npz", "--method", method, "--crs", UTM, "--sigma", "0.03", "-q"],
            wrong == "npz of one point",
        )
        for wrong, prepare in _SCANS.items()
        for method in ("carving", "emap", "field")
    ]


_TRACK = "0.0 1.0 2.0 3.0 0.0 0.0 0.0 1.0\n1.0 2.0 2.0 3.0 0.0 0.0 0.0 1.0\n"
TRACKS: dict[str, str | bytes] = {
    "empty": b"",
    "seven columns": "0.0 1.0 2.0 3.0 0.0 0.0 1.0\n",
    "words": _TRACK + "one two three four five six seven eight\n",
    "no turn": _TRACK.replace("0.0 0.0 0.0 1.0", "0.0 0.0 0.0 0.0"),
    "time that goes back": _TRACK + "0.5 1.0 2.0 3.0 0.0 0.0 0.0 1.0\n",
    "NaN": _TRACK.replace("2.0 2.0", "nan 2.0"),
    "not UTF-8": _TRACK.encode() + b"\xff\xff",
}


def _track_cases() -> list[Case]:
    scan = _scan
    return [
        case
        for wrong, content in TRACKS.items()
        for case in (
            Case(
                f"track {wrong} · reconstruct --trajectory",
                both(scan, text("bad.tum", content)),
                [
                    "reconstruct",
                    "scan.npz",
                    "--method",
                    "field",
                    "--trajectory",
                    "bad.tum",
                    "--crs",
                    UTM,
                    "--sigma",
                    "0.03",
                    "-q",
                ],
                True,  # scans that state their origins need none
            ),
            Case(
                f"track {wrong} · export",
                text("bad.tum", content),
                ["export", "bad.tum", "out.gpx", "--as", "track", "--crs", UTM],
            ),
        )
    ]


def _scan(folder: Path) -> None:
    xyz = np.random.default_rng(3).random((500, 3)) * [10.0, 10.0, 0.1]
    np.savez(folder / "scan.npz", xyz=xyz, origins=np.tile([5.0, 5.0, 2.0], (500, 1)))


def table_cases() -> list[Case]:
    """Return every bad table at every place."""
    return _point_cases() + _scan_cases() + _track_cases()
