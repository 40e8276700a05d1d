"""Outputs that cannot be written, run folders that were damaged, and recordings that are none."""

import json
from collections.abc import Callable
from pathlib import Path

from benchmarks.bad_input.case import Case, Prepare, both, text
from benchmarks.bad_input.good import MISSION, UTM, area, points, raster

_SITE = both(
    area, raster("dem.tif"), raster("map.tif", 0.1), points, text("m.toml", MISSION), text("file", "x")
)
# Commands that write, with OUT where the place goes.
_WRITERS: dict[str, list[str]] = {
    "plan": ["plan", "area.gpkg", "-q", "-o", "OUT/route.geojson"],
    "reconstruct": ["reconstruct", "points.csv", "--crs", UTM, "--grid", "10", "-q", "-o", "OUT"],
    "change": ["change", "map.tif", "dem.tif", "--outline", "area.gpkg", "-o", "OUT"],
    "export": ["export", "points.csv", "OUT/points.ply", "--as", "points", "--crs", UTM],
    "init": ["init", "OUT/new.toml"],
    "run": ["run", "m.toml", "-q", "--runs", "OUT"],
    "montecarlo": ["montecarlo", "m.toml", "-q", "--runs", "OUT"],
    "reproduce": ["reproduce", "glacier-tables", "-q", "-o", "OUT"],
    "localize": ["localize", "missing", "-q", "-o", "OUT"],
}
_OUTS = {
    "below a file": "file/deeper",
    "a device": "/dev/null/x",
    "a name of 300 letters": "n" * 300,
    "proc": "/proc/none",
}


def _output_cases() -> list[Case]:
    return [
        Case(f"output {where} · {command}", _SITE, [arg.replace("OUT", out) for arg in args])
        for command, args in _WRITERS.items()
        for where, out in _OUTS.items()
    ]


def _over_input() -> list[Case]:
    route = {"type": "FeatureCollection", "features": []}
    return [
        Case(
            "plan over its own area",
            both(_SITE, lambda folder: (folder / "area.gpkg").rename(folder / "route.gpkg") and None),
            ["plan", "route.gpkg", "-q", "-o", "route.gpkg"],
        ),
        Case(
            "plan over a route",
            both(_SITE, text("route.geojson", json.dumps(route))),
            ["plan", "area.gpkg", "-q"],
        ),
        Case("plan over a picture", both(_SITE, text("route.png", "precious")), ["plan", "area.gpkg", "-q"]),
        Case("export over its source", _SITE, ["export", "dem.tif", "dem.tif"]),
        Case("export over its source by force", _SITE, ["export", "dem.tif", "./dem.tif", "--force"]),
        Case("init over a mission", _SITE, ["init", "m.toml"]),
        Case(
            "reconstruct over a map",
            both(_SITE, lambda folder: (folder / "r").mkdir(), text("r/dem.tif", "precious")),
            ["reconstruct", "points.csv", "--crs", UTM, "--grid", "10", "-q", "-o", "r"],
        ),
    ]


def _manifest(change: Callable[[dict[str, object]], object]) -> Prepare:
    """Return a preparation that runs a mission's first stage and edits its manifest."""

    def prepare(folder: Path) -> None:
        from sim.mission.runs import open_run, read_mission
        from sim.mission.stages import run_mission

        (folder / "m.toml").write_text(MISSION)
        mission = read_mission(folder / "m.toml", ())
        run = open_run(mission, folder / "runs")
        run_mission(mission, run, until="plan")
        (folder / "run").symlink_to(run.path)
        file = run.path / "manifest.json"
        changed = change(json.loads(file.read_text()))
        if isinstance(changed, bytes):
            file.write_bytes(changed)
        else:
            file.write_text(json.dumps(changed))

    return prepare


def _without(key: str) -> Callable[[dict[str, object]], object]:
    return lambda manifest: {k: v for k, v in manifest.items() if k != key}


def _with(**values: object) -> Callable[[dict[str, object]], object]:
    return lambda manifest: {**manifest, **values}


MANIFESTS: dict[str, Callable[[dict[str, object]], object]] = {
    "empty": lambda _: b"",
    "no JSON": lambda _: b"{",
    "not UTF-8": lambda _: b'{"\xff": 1}',
    "a list": lambda _: [],
    "a number": lambda _: 3,
    "null": lambda _: None,
    "empty object": lambda _: {},
    "no stages": _without("stages"),
    "stages of text": _with(stages="all"),
    "stages of numbers": _with(stages={"plan": 3}),
    "no checksums": _with(stages={"plan": {"wall_s": 1.0}}),
    "checksums of numbers": _with(stages={"plan": {"wall_s": 1.0, "files_sha256": {"route.geojson": 3}}}),
    "a time of text": _with(stages={"plan": {"wall_s": "long", "files_sha256": {}}}),
    "an unknown stage": _with(stages={"dream": {"wall_s": 1.0, "files_sha256": {}}}),
    "a file outside": _with(stages={"plan": {"wall_s": 1.0, "files_sha256": {"../../../x": "0" * 64}}}),
    "nested 20,000 deep": lambda _: b"[" * 20_000 + b"]" * 20_000,
}


def _run_cases() -> list[Case]:
    cases = []
    for wrong, change in MANIFESTS.items():
        uses = {
            "show": ["show", "run"],
            "report": ["report", "run"],
            "run": ["run", "m.toml", "--runs", "runs", "--until", "plan", "-q"],
            "export": ["export", "run", "route.gpx"],
        }
        cases += [
            Case(f"manifest {wrong} · {place}", _manifest(change), args) for place, args in uses.items()
        ]
    return cases


def _not_runs() -> list[Case]:
    return [
        Case(f"no run: {name} · {command}", prepare, [command, "run"])
        for name, prepare in {
            "missing": both(),
            "empty folder": lambda folder: (folder / "run").mkdir(),
            "file": text("run", "x"),
        }.items()
        for command in ("show", "report", "fit")
    ]


def _folder(**files: bytes) -> Prepare:
    def prepare(folder: Path) -> None:
        for name, content in files.items():
            file = folder / "drive" / name.replace("__", "/").replace("_dot_", ".")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)

    return prepare


_PNG = b"\x89PNG\r\n\x1a\n" + bytes(40)
DRIVES: dict[str, Prepare] = {
    "missing": both(),
    "a file": text("drive", "x"),
    "empty folder": lambda folder: (folder / "drive").mkdir(),
    "text alone": _folder(readme_dot_txt=b"hello"),
    "KITTI without images": _folder(times_dot_txt=b"0\n1\n", calib_dot_txt=b"P0: 1 0 0 0 0 1 0 0 0 0 1 0\n"),
    "damaged images": _folder(
        image_0__000000_dot_png=_PNG,
        image_0__000001_dot_png=_PNG,
        times_dot_txt=b"0\n1\n",
        calib_dot_txt=b"P0: 700 0 600 0 0 700 180 0 0 0 1 0\n",
    ),
    "calibration of words": _folder(
        image_0__000000_dot_png=_PNG, times_dot_txt=b"0\n", calib_dot_txt=b"P0: a b c\n"
    ),
    "broken recording": _folder(recording_dot_json=b"{"),
    "recording of a list": _folder(recording_dot_json=b"[]"),
    "recording of nothing": _folder(recording_dot_json=b"{}"),
    "bag of zeros": _folder(metadata_dot_yaml=b"rosbag2_bagfile_information: 3\n"),
    "bag of broken YAML": _folder(metadata_dot_yaml=b"a: [\n"),
}


def _drive_cases() -> list[Case]:
    return [
        Case(f"drive {wrong}{' '.join(['', *more])}", prepare, ["localize", "drive", "-q", *more])
        for wrong, prepare in DRIVES.items()
        for more in ([], ["--camera", "camera.toml"], ["--gps", "fixes.csv"])
    ]


def place_cases() -> list[Case]:
    """Return bad outputs, run folders and recordings."""
    return _output_cases() + _over_input() + _run_cases() + _not_runs() + _drive_cases()
