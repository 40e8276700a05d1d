"""Bad mission files, study files and options."""

from benchmarks.bad_input.case import Case, both, text
from benchmarks.bad_input.good import DEM_MISSION, MISSION, STUDY, UTM, area, points, raster

_NUMBERS = ("0", "-1", "nan", "inf", "1e300", "1e-300", "three", "")


def _edited(old: str, new: str, source: str = MISSION) -> str:
    assert old in source, old
    return source.replace(old, new)


_DEEP = "a = " + "[" * 20_000 + "]" * 20_000 + "\n"
MISSIONS: dict[str, str | bytes] = {
    "empty": b"",
    "broken TOML": "schema_version = ",
    "not UTF-8": MISSION.encode() + b"# \xff\xfe\n",
    "nested 20,000 deep": MISSION + _DEEP,
    "table twice": MISSION + "[planner]\nswaths = 3\n",
    "unknown key": _edited("swaths = 2", "swathes = 2"),
    "unknown section": MISSION + "[sensor]\n",
    "wrong unit": _edited("size_m", "size_km"),
    "zero swaths": _edited("swaths = 2", "swaths = 0"),
    "half a swath": _edited("swaths = 2", "swaths = 2.5"),
    "a million swaths": _edited("swaths = 2", "swaths = 1000000"),
    "text for a number": _edited("150.0", '"150"'),
    "NaN": _edited("150.0", "nan"),
    "infinite": _edited("150.0", "inf"),
    "negative seed": "seed = -1\n" + MISSION,
    "half a seed": "seed = 1.5\n" + MISSION,
    "later schema": _edited("schema_version = 1", "schema_version = 99"),
    "no planner": MISSION[: MISSION.index("[planner]")],
    "no name": _edited('name = "m"', ""),
    "name with a slash": _edited('"m"', '"../m"'),
    "empty name": _edited('"m"', '""'),
    "name of control characters": _edited('"m"', '"\\u001b[31mred"'),
    "name of 10,000 letters": _edited('"m"', '"' + "m" * 10_000 + '"'),
    "unknown terrain": _edited('"random"', '"moon"'),
    "unknown pattern": _edited('"lawnmower"', '"spiral"'),
    "grid of 0.001 m": MISSION + "[reconstruction]\ngrid_step_m = 0.001\n",
    "grid of 0 m": MISSION + "[reconstruction]\ngrid_step_m = 0\n",
    "terrain of 1e-6 m": _edited("step_m = 3.0", "step_m = 0.000001"),
    "site of 1e9 m": _edited("150.0", "1e9"),
    "length scale of 1e-9 m": _edited("step_m = 3.0", "step_m = 3.0\nlength_scale_m = 1e-9"),
    "prior cells that do not fit": _edited("cell_m = 75.0", "cell_m = 20.0"),
    "prior cells larger than the site": _edited("cell_m = 75.0", "cell_m = 7500.0"),
    "missing raster": DEM_MISSION,
    "rovers by the million": MISSION + "[fleet]\nrovers = 1000000\n",
    "list for a number": _edited("swaths = 2", "swaths = [2]"),
    "NUL": MISSION.encode() + b"\x00",
    "Windows-1252": MISSION.encode() + "# Gletscherfläche".encode("cp1252"),
}
STUDIES: dict[str, str | bytes] = {
    "empty": b"",
    "broken TOML": "trials = ",
    "nested 20,000 deep": STUDY + _DEEP,
    "trials of 1e12": _edited("trials = 2", "trials = 1000000000000", STUDY),
    "no trials": _edited("trials = 2", "trials = 0", STUDY),
    "no terrain": STUDY[: STUDY.index("[[terrains]]")] + STUDY[STUDY.index("[[planners]]") :],
    "no planner": STUDY[: STUDY.index("[[planners]]")],
    "unknown family": _edited("squared-exponential", "wobbly", STUDY),
    "a million swaths": _edited("[2]", "[1000000]", STUDY),
    "negative swaths": _edited("[2]", "[-2]", STUDY),
    "length scale of 1e-9 m": _edited("length_scale_m = 50.0", "length_scale_m = 1e-9", STUDY),
    "length scale of 0 m": _edited("length_scale_m = 50.0", "length_scale_m = 0", STUDY),
    "unknown key": STUDY + "wind = 3\n",
    "two of a name": STUDY + STUDY[STUDY.index("[[terrains]]") : STUDY.index("[[planners]]")],
    "a mission": MISSION,
}


def _file_cases() -> list[Case]:
    cases = []
    for wrong, content in MISSIONS.items():
        for command in (["run", "m.toml", "-q"], ["plan", "m.toml", "-q"], ["simulate", "m.toml", "-q"]):
            cases.append(
                Case(f"mission {wrong} · {command[0]}", text("m.toml", content), [*command, "--runs", "runs"])
            )
    for wrong, content in STUDIES.items():
        args = ["montecarlo", "s.toml", "--runs", "runs", "--engine", "serial", "-q"]
        cases.append(Case(f"study {wrong}", text("s.toml", content), args))
    return cases


_OVERRIDES = (
    "planner.swaths",
    "planner.swaths=",
    "planner.swaths=two",
    "=3",
    "planner.swaths=3=4",
    "planner..swaths=3",
    "nowhere.at=1",
    "planner.swaths=" + "[" * 5000,
    "name=a/b",
    "planner=3",
    "terrain.step_m=1e-9",
)


def _override_cases() -> list[Case]:
    runs = [
        Case(
            f"--set {o[:30]!r} · run",
            text("m.toml", MISSION),
            ["run", "m.toml", "--runs", "runs", "-q", "--set", o],
        )
        for o in _OVERRIDES
    ]
    maps = [
        Case(
            f"--set {o[:30]!r} · reconstruct",
            points,
            ["reconstruct", "points.csv", "--crs", UTM, "--grid", "10", "-q", "--set", o],
        )
        for o in (*_OVERRIDES, "reconstruction.unknown=1", "reconstruction.gp.kernel=wobbly")
    ]
    return runs + maps


_SITE = both(area, raster("dem.tif"), points)
# Options that take a number, and what stands before them; values that can be right are skipped.
_PLAN = ["plan", "area.gpkg", "-q"]
_PRIOR = [*_PLAN, "--prior", "dem.tif"]
_PROMISE = [*_PRIOR, "--require", "class-3"]
_MAP = ["reconstruct", "points.csv", "--crs", UTM, "-q"]
_NUMERIC: dict[str, tuple[list[str], frozenset[str]]] = {
    "--swaths": (_PLAN, frozenset()),
    "--spacing": (_PLAN, frozenset({"1e300"})),
    "--budget": ([*_PRIOR, "--pattern", "best"], frozenset({"1e300", "inf"})),
    "--rmse": ([*_PRIOR, "--pattern", "best"], frozenset({"1e300", "inf"})),
    "--rovers": (_PLAN, frozenset()),
    "--max-slope": (_PRIOR, frozenset({"1e300", "inf"})),
    "--probability": (_PROMISE, frozenset({"1e-300"})),
    "--noise": (_PROMISE, frozenset({"0", "1e-300"})),
    "--localization": (_PROMISE, frozenset({"0", "1e-300"})),
    "--prior-sigma": (_PROMISE, frozenset({"0", "1e-300"})),
    "--grid": (_MAP, frozenset({"1e300"})),
    "--sigma": (_MAP, frozenset({"0", "-1", "nan", "inf", "1e300", "1e-300"})),  # the points state theirs
    "--workers": (["montecarlo", "s.toml", "--runs", "runs", "-q"], frozenset()),
}


def _option_cases() -> list[Case]:
    cases = []
    for option, (args, fine) in _NUMERIC.items():
        for value in _NUMBERS:
            prepare = both(_SITE, text("s.toml", STUDY))
            cases.append(Case(f"{option} {value!r}", prepare, [*args, option, value], value in fine))
    return cases


_ON_DASK = ["montecarlo", "s.toml", "--runs", "runs", "--engine", "dask", "--scheduler"]
_WORDS: dict[str, list[str]] = {
    "plan --pattern": [*_PLAN, "--pattern", "spiral"],
    "plan --product": [*_PRIOR, "--max-slope", "20", "--product", "banana"],
    "plan --product without a limit": [*_PRIOR, "--product", "aster-30"],
    "plan --crs": [*_PLAN, "--crs", "EPSG:banana"],
    "plan --crs in degrees": [*_PLAN, "--crs", "EPSG:4326"],
    "plan --require": [*_PRIOR, "--require", "class-9"],
    "plan --require of a negative error": [*_PRIOR, "--require", "-3"],
    "plan --assume": [*_PROMISE, "--assume", "wobbly"],
    "plan --adaptive without a route": [
        *_PROMISE,
        "--adaptive",
        "--driven",
        "nowhere.geojson",
        "--measured",
        "points.csv",
    ],
    "plan -o .docx": [*_PLAN, "-o", "route.docx"],
    "plan of a raster": ["plan", "dem.tif"],
    "reconstruct --method": [*_MAP, "--method", "magic"],
    "reconstruct --value": [*_MAP, "--grid", "10", "--value", "temperature_c"],
    "reconstruct --crs": ["reconstruct", "points.csv", "--crs", "moon"],
    "reconstruct --max-slope without --rays": [*_MAP, "--max-slope", "20"],
    "reconstruct --grid 0.001": [*_MAP, "--grid", "0.001"],
    "reconstruct dense --grid 0.001": [*_MAP, "--grid", "0.001", "--method", "dense"],
    "reconstruct tin --grid 0.0001": [*_MAP, "--grid", "0.0001", "--method", "tin"],
    "score --standard": ["score", "dem.tif", "--checkpoints", "points.csv", "--standard", "mine"],
    "score --class -1": ["score", "dem.tif", "--checkpoints", "points.csv", "--class", "-1"],
    "score --class nan": ["score", "dem.tif", "--checkpoints", "points.csv", "--class", "nan"],
    "score --datum": ["score", "dem.tif", "--checkpoints", "points.csv", "--datum", "the sea"],
    "score of nothing": ["score", "dem.tif"],
    "change --density -5": ["change", "dem.tif", "dem.tif", "--outline", "area.gpkg", "--density", "-5"],
    "change --density nan": ["change", "dem.tif", "dem.tif", "--outline", "area.gpkg", "--density", "nan"],
    "export --as": ["export", "points.csv", "out.ply", "--as", "poem"],
    "export --rover 7": ["export", "points.csv", "out.gpx", "--as", "route", "--rover", "7"],
    "reproduce": ["reproduce", "glacier-fig99"],
    "run --from": ["run", "s.toml", "--from", "nowhere"],
    "montecarlo --engine": ["montecarlo", "s.toml", "--runs", "runs", "--engine", "steam"],
    "montecarlo --scheduler": [*_ON_DASK, "tcp://127.0.0.1:9"],
    "montecarlo --scheduler without an address": [*_ON_DASK, "banana"],
    "unknown command": ["survey"],
    "unknown option": ["run", "s.toml", "--faster"],
}


def setting_cases() -> list[Case]:
    """Return bad missions, studies, overrides and options."""
    words = [
        Case(f"option {name}", both(_SITE, text("s.toml", STUDY)), args, name == "score --datum")
        for name, args in _WORDS.items()
    ]
    return _file_cases() + _override_cases() + _option_cases() + words
