"""The command, the Python call and the planning desk write the same files from one small messy input.

The input is legal and untidy: an area in degrees with a hole, points in degrees with a column of an odd name and one blunder, and
a prior with voids. Every command of the command line is in `DOORS`, or in `WITHOUT_FILES` with the reason why nothing is compared.
"""

import json
import re
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
import typer
from pyproj import Transformer
from typer.testing import CliRunner

from benchmarks.small_inputs import STUDY
from desk.jobs.job import Job
from desk.jobs.mission import mission_run
from desk.measured import measured_map
from desk.plan.document import PlanDocument
from desk.plan.exports import PlanExport
from desk.plan.live import LivePlanner
from firnline import MissionConfig, actions
from firnline.actions.interface import Result, preview_of
from firnline.cli.guide import examples_folder
from firnline.cli.main import app
from papers.studies import replacing_study, study
from sim.mission.runs import json_schema
from survey import Dem, Grid, Route, SurveyArea
from survey.core.text import round_number
from tests.docs.scratch import write_ditch, write_serac
from tests.vision_slam.rendered import chessboard_images
from tests.vision_slam.tilted_plane import write_drive

CRS = "EPSG:32608"
WEST, SOUTH = 500_000.0, 6_700_000.0
BOUNDS = (WEST, SOUTH, WEST + 600.0, SOUTH + 600.0)
MISSION = """
schema_version = 1
name = "small"
seed = 11
fidelity = "statistical"
terrain = { source = "random", size_m = 150.0, step_m = 3.0, relief_m = 6.0, length_scale_m = 60.0 }
planner = { pattern = "lawnmower", swaths = 3 }
[reconstruction]
grid_step_m = 5.0
gp = { fit = false, variance_m2 = 4.0, length_scale_m = 60.0 }
"""

# ---- what differs by the clock, named one by one
CLOCK = {
    "manifest.json": r'"(wall_s|finished|started|created|manifest_sha256)": [^\n]*',
    "made.json": r'"(cpu_s|wall_s|date|record_sha256)": [^\n]*',
    "log.jsonl": r'"(time|line_sha256)": "[^"]*"',
    "index.html": r"[0-9.]+ s\b",
    "timing.json": r".*",
}
"""Files with the time of the clock or of the work, and the pattern of it."""


class Door(NamedTuple):
    """One command: its words, the Python call for the same files, and the desk where it offers them."""

    words: tuple[str, ...]
    call: Callable[[], Result]
    desk: "Callable[[], None] | None" = None
    of_desk: tuple[str, ...] = ()
    is_long: bool = False
    no_desk: str = "the desk does not offer it"
    """Why the table compares no file of the desk."""


def hills() -> Dem:
    """Return hills near 1,000 m on cells of 60 m about the area."""
    grid = Grid((WEST - 300.0, SOUTH - 300.0, WEST + 900.0, SOUTH + 900.0), 60.0, CRS)
    x, y = grid.xy.T - np.array([[WEST], [SOUTH]])
    heights = 1000.0 + 12.0 * np.sin(x / 90.0) + 9.0 * np.cos(y / 70.0 + x / 200.0)
    return Dem.on(grid, heights.reshape(grid.shape))


def degrees(xy: np.ndarray) -> np.ndarray:
    return np.column_stack(Transformer.from_crs(CRS, "EPSG:4326", always_xy=True).transform(*xy.T))


def write_inputs(folder: Path) -> None:
    """Write the messy input of all commands."""
    rng = np.random.default_rng(7)
    outline = np.array([[40, 40], [560, 60], [540, 560], [60, 540], [40, 40]], dtype=float)
    hole = np.array([[250, 250], [330, 250], [330, 330], [250, 330], [250, 250]], dtype=float)
    rings = [degrees(ring + [WEST, SOUTH]).tolist() for ring in (outline, hole)]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": rings}}
    site = {"type": "FeatureCollection", "features": [feature]}
    (folder / "site.geojson").write_text(json.dumps(site))
    terrain = hills()
    voids = terrain.elevation.copy()
    voids[7:8, 15:16] = np.nan
    Dem.on(terrain.grid(), voids).write(folder / "prior.tif")
    terrain.write(folder / "truth.tif")
    Dem.on(terrain.grid(), voids + 0.3).write(folder / "later.tif")
    xy = rng.uniform([WEST + 45, SOUTH + 45], [WEST + 555, SOUTH + 555], (260, 2))
    z = terrain.at(xy) + 0.02 * rng.standard_normal(len(xy))
    z[17] += 4000.0
    rows = [f"{lon:.9f};{lat:.9f};{h:.3f}" for (lon, lat), h in zip(degrees(xy), z, strict=True)]
    (folder / "points.csv").write_text("\n".join(["Laenge;Breite;Hoehe ueber NN", *rows]) + "\n")
    plain = [f"{x:.3f},{y:.3f},{h:.3f},0.05" for (x, y), h in zip(xy, z, strict=True)]
    (folder / "plain.csv").write_text("\n".join(["x_m,y_m,z_m,sigma_z_m", *plain]) + "\n")
    checked = xy[:40]
    rows = [f"{x:.3f},{y:.3f},{h:.3f}" for (x, y), h in zip(checked, terrain.at(checked), strict=True)]
    (folder / "gnss.csv").write_text("\n".join(["x_m,y_m,z_m", *rows]) + "\n")
    warm = [f"{x:.2f},{y:.2f},{-4.0 + np.sin(x / 50.0):.4f}" for x, y in xy]
    counted = [f"{x},{y},{3 + (7 * k) % 5},10" for k, (x, y) in enumerate(xy)]
    write_serac(folder / "serac.ply")
    write_ditch(folder)
    write_drive(folder)
    (folder / "gamma.csv").write_text("\n".join(["easting_m,northing_m,counts,exposure_s", *counted]) + "\n")
    (folder / "log.csv").write_text("\n".join(["easting_m,northing_m,air_temperature", *warm]) + "\n")
    (folder / "mine.toml").write_text(MISSION)
    (folder / "study.toml").write_text("seed = 5\n" + STUDY)
    (folder / "board").mkdir()
    chessboard_images(folder / "board", n=9, seed=3)


def document() -> PlanDocument:
    area = SurveyArea.read("site.geojson", crs=CRS)
    return PlanDocument.of_area(area, planner={"pattern": "lawnmower", "swaths": 4})


def export_of_desk(kind: str, out: str) -> Callable[[], None]:
    def write() -> None:
        live = LivePlanner(Path("prior.tif"), Dem.read("prior.tif").crs).exact(document())
        Path(out).write_bytes(PlanExport(live, document(), "plan", Path("prior.tif")).file(kind).content)

    return write


def map_of_desk() -> None:
    area = document().survey_area(Dem.read("prior.tif").crs)
    measured_map(
        area, Path("plain.csv"), Path("prior.tif"), Path(), checkpoints=None, progress=lambda *_: None
    )


def desk_step_m() -> float:
    """Return the grid step that the desk takes for its drawing [m]."""
    xmin, ymin, xmax, ymax = document().survey_area(Dem.read("prior.tif").crs).bounds
    return round_number(max(xmax - xmin, ymax - ymin) / 150.0)


COLUMNS = "lon=Laenge,lat=Breite,z=Hoehe ueber NN"
DOORS = {
    "init": Door(
        ("mission.toml", "--dem", "prior.tif"),
        lambda: actions.init(actions.InitRequest(path=Path("mission.toml"), dem=Path("prior.tif"))),
    ),
    "plan": Door(
        ("site.geojson", "--prior", "prior.tif", "--swaths", "4", "-o", "route.geojson"),
        lambda: actions.plan(
            actions.PlanRequest(
                source=Path("site.geojson"), prior=Path("prior.tif"), swaths=4, out=Path("route.geojson")
            )
        ),
        desk=export_of_desk(".geojson", "route.geojson"),
        of_desk=("route.geojson",),
    ),
    "reconstruct": Door(
        ("points.csv", "--columns", COLUMNS, "--sigma", "0.05", "--prior", "prior.tif")
        + ("--area", "site.geojson", "--crs", CRS, "--grid", "15", "-o", "map"),
        lambda: actions.reconstruct(
            actions.ReconstructRequest(
                sources=[Path("points.csv")],
                columns=[COLUMNS],
                sigma_m=0.05,
                prior=Path("prior.tif"),
                area=Path("site.geojson"),
                crs=CRS,
                step_m=15.0,
                out=Path("map"),
            )
        ),
        no_desk="compared below, with the area that the desk writes",
    ),
    "calibrate": Door(
        ("board", "--board", "9x6", "--square-mm", "20"),
        lambda: actions.calibrate(
            actions.CalibrateRequest(images=Path("board"), board="9x6", square_mm=20.0)
        ),
    ),
    "localize": Door(
        ("runs/small/latest/2-simulate/recording", "-o", "path"),
        lambda: actions.localize(
            actions.LocalizeRequest(source=Path("runs/small/latest/2-simulate/recording"), out=Path("path"))
        ),
    ),
    "payload": Door(
        ("log.csv", "--name", "air_temperature", "--unit", "degC", "--terrain", "truth.tif", "-o", "warm"),
        lambda: actions.payload(
            actions.PayloadRequest(
                logs=[Path("log.csv")],
                name="air_temperature",
                unit="degC",
                terrain=Path("truth.tif"),
                out=Path("warm"),
            )
        ),
    ),
    "counts": Door(
        ("gamma.csv", "--crs", "EPSG:32608", "--grid", "8", "-o", "gamma"),
        lambda: actions.count_map(
            actions.CountsRequest(counts=Path("gamma.csv"), crs="EPSG:32608", grid=8.0, out=Path("gamma"))
        ),
    ),
    "extend": Door(
        ("drive", "localized", "--reach", "20", "--grid", "2", "--pixel", "0.5", "-o", "beyond"),
        lambda: actions.extend(
            actions.ExtendRequest(
                recording=Path("drive"),
                localization=Path("localized"),
                reach_m=20.0,
                grid=2.0,
                pixel_m=0.5,
                out=Path("beyond"),
            )
        ),
    ),
    "overhangs": Door(
        ("serac.ply", "--grid", "0.4", "-o", "serac"),
        lambda: actions.overhangs(
            actions.OverhangsRequest(sources=[Path("serac.ply")], step_m=0.4, out=Path("serac"))
        ),
    ),
    "reroute": Door(
        ("line.geojson", "seen.csv", "-o", "around"),
        lambda: actions.reroute(
            actions.RerouteRequest(route=Path("line.geojson"), points=Path("seen.csv"), out=Path("around"))
        ),
    ),
    "score": Door(
        (
            "later.tif",
            "--truth",
            "truth.tif",
            "--area",
            "site.geojson",
            "--by",
            "slope",
            "--report",
            "judged",
        ),
        lambda: actions.score(
            actions.ScoreRequest(
                source=Path("later.tif"),
                truth=Path("truth.tif"),
                area=Path("site.geojson"),
                by=["slope"],
                report=Path("judged"),
            )
        ),
        no_desk="the desk states the score of its map in sentences, from the same action",
    ),
    "change": Door(
        ("later.tif", "prior.tif", "--outline", "site.geojson", "-o", "changed"),
        lambda: actions.change(
            actions.ChangeRequest(
                later=Path("later.tif"),
                earlier=Path("prior.tif"),
                outline=Path("site.geojson"),
                out=Path("changed"),
            )
        ),
    ),
    "track": Door(
        ("truth.tif", "later.tif", "--days", "10", "--window", "9", "--search", "2", "-o", "moved.gpkg"),
        lambda: actions.track(
            actions.TrackRequest(
                earlier=Path("truth.tif"),
                later=Path("later.tif"),
                days=10.0,
                window_px=9,
                search_px=2,
                out=Path("moved.gpkg"),
            )
        ),
    ),
    "export": Door(
        ("drawn.geojson", "drawn.gpx", "--area", "site.geojson", "--dem", "truth.tif"),
        lambda: actions.export(
            actions.ExportRequest(
                source=Path("drawn.geojson"),
                out=Path("drawn.gpx"),
                area=Path("site.geojson"),
                dem=Path("truth.tif"),
            )
        ),
        no_desk="compared below, for a route of the desk",
    ),
    "simulate": Door(
        ("mine.toml", "--runs", "simulated", "-q"),
        lambda: actions.simulate(actions.SimulateRequest(mission=Path("mine.toml"), runs=Path("simulated"))),
        no_desk="the desk runs all stages",
    ),
    "run": Door(
        ("mine.toml", "--runs", "all", "-q"),
        lambda: actions.run(actions.RunRequest(mission=Path("mine.toml"), runs=Path("all"))),
        no_desk="compared below",
        is_long=True,
    ),
    "report": Door(
        ("runs/small/latest", "-q"),
        lambda: actions.report(actions.ReportRequest(source=Path("runs/small/latest"))),
        is_long=True,
    ),
    "montecarlo": Door(
        ("study.toml", "--runs", "studies", "--engine", "serial", "-q"),
        lambda: actions.montecarlo(
            actions.MonteCarloRequest(study=Path("study.toml"), runs=Path("studies"), engine="serial")
        ),
    ),
    "rehearse": Door(
        ("mine.toml", "--count", "1", "--engine", "serial", "--runs", "rehearsed", "-q"),
        lambda: actions.rehearse(
            actions.RehearseRequest(
                mission=Path("mine.toml"), n_runs=1, engine="serial", runs=Path("rehearsed")
            )
        ),
        is_long=True,
    ),
    "watch": Door(
        ("samples.csv", "--area", "site.gpkg", "--route", "drawn.geojson", "--once", "--log", "drive.jsonl"),
        lambda: actions.watch(
            actions.WatchRequest(
                source="samples.csv",
                area=Path("site.gpkg"),
                route=Path("drawn.geojson"),
                once=True,
                log=Path("drive.jsonl"),
            )
        ),
        no_desk="the desk follows the log and writes none",
    ),
}
WITHOUT_FILES = {
    "desk": "serves a page until it is stopped; its plans are files of its own",
    "upload": "sends a mission to a vehicle and writes no file; what --dry-run prints is compared below",
    "download": "reads a mission from a vehicle; tests/live holds the route against the vehicle's",
    "rover": "simulates a vehicle until it is stopped and writes no file",
    "fit": "prints settings from runs with images, which take minutes; the action returns the printed text",
    "show": "prints the record of a run and writes no file; its lines are compared below",
    "reproduce": "makes the figures of the papers; one is compared with its function below",
    "doctor": "checks the machine and reads no data",
    "example": "copies a file of the package, compared below",
    "examples": "is a second name of example",
    "schema": "prints the schema of mission files, compared below",
    "help": "explains a topic and reads no data",
}


@pytest.fixture(autouse=True)
def one_thread():
    """Let OpenCV sum in one order: its threads change the last digits of a calibration from run to run."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(threads)


@pytest.fixture(scope="module")
def messy(tmp_path_factory) -> Path:
    """Folder with the input, a route, a simulated run, and the samples of a drive."""
    folder = tmp_path_factory.mktemp("messy")
    write_inputs(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        SurveyArea.read("site.geojson", crs=CRS).write("site.gpkg")
        route = DOORS["plan"].call().route
        route.write("drawn.geojson")
        actions.run(actions.RunRequest(mission=Path("mine.toml"), runs=Path("runs"), until="score"))
        along = route.path()[:, :2]
        xy = np.vstack([np.linspace(a, b, 12) for a, b in pairwise(along)])
        rows = [
            f"{k},{x:.3f},{y:.3f},{z:.3f},0.02"
            for k, ((x, y), z) in enumerate(zip(xy, hills().at(xy), strict=True))
        ]
        Path("samples.csv").write_text("\n".join(["time_s,x_m,y_m,z_m,sigma_z_m", *rows]) + "\n")
    return folder


def in_copy(messy: Path, place: Path, work: Callable[[], object]) -> dict[str, bytes]:
    """Do the work in a copy of the input, always at one place, and return the files that it wrote or changed."""
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(messy, place, symlinks=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        before = contents(Path())
        work()
        after = contents(Path())
    return {name: content for name, content in after.items() if before.get(name) != content}


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files below a folder without what the clock decides."""
    files = (file for file in sorted(folder.rglob("*")) if file.is_file() and not file.is_symlink())
    return {file.as_posix(): without_clock(file) for file in files}


def without_clock(file: Path) -> bytes:
    pattern = CLOCK.get(file.name)
    content = file.read_bytes()
    return content if pattern is None else re.sub(pattern.encode(), b"", content)


def commanded(name: str, words: tuple[str, ...]) -> str:
    done = CliRunner().invoke(app, [name, *words])
    assert done.exit_code == 0, done.output
    return done.stdout


def written(result: Result) -> Result:
    """Write a result that is not written while it is computed."""
    return result.write()


def test_the_table_holds_every_command():
    group = typer.main.get_command(app)
    assert set(DOORS) | set(WITHOUT_FILES) == set(group.commands)
    assert not set(DOORS) & set(WITHOUT_FILES)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.long if door.is_long else ()) for name, door in DOORS.items()],
)
def test_command_and_python_call_write_the_same_files(name, messy, tmp_path):
    door, printed = DOORS[name], []
    by_command = in_copy(messy, tmp_path / "work", lambda: printed.append(commanded(name, door.words)))
    results = []
    by_call = in_copy(messy, tmp_path / "work", lambda: results.append(written(door.call())))
    assert by_command
    assert {file for file in by_command if by_command[file] != by_call.get(file)} == set()
    assert set(by_call) == set(by_command)
    if door.desk is not None:
        by_desk = in_copy(messy, tmp_path / "work", door.desk)
        assert {file: by_desk[file] for file in door.of_desk} == {
            file: by_command[file] for file in door.of_desk
        }


def test_the_desk_maps_measurements_as_its_command_does(messy, tmp_path):
    by_desk = in_copy(messy, tmp_path / "work", map_of_desk)

    def of_command() -> None:
        document().survey_area(Dem.read("prior.tif").crs).write("area.gpkg")
        words = ("plain.csv", "--prior", "prior.tif", "--area", "area.gpkg", "--grid", f"{desk_step_m():g}")
        commanded("reconstruct", (*words, "--crs", CRS, "--sigma", "0.05", "-o", "map"))

    # That the Python call writes what the command does is tested above.
    assert "map/dem.tif" in by_desk
    assert in_copy(messy, tmp_path / "work", of_command) == by_desk
    facts = json.loads(by_desk["map/reconstruction.json"])["diagnostics"]
    assert facts["blunders"][0]["rows"] == [17]


@pytest.mark.parametrize("kind", [".gpkg", ".gpx", ".plan"])
def test_the_desk_exports_a_route_as_the_command_does(kind, messy, tmp_path):
    out = f"plan{kind}"
    by_desk = in_copy(messy, tmp_path / "work", export_of_desk(kind, out))

    def of_command() -> None:
        area = document().survey_area(Dem.read("prior.tif").crs)
        area.write("area.gpkg")
        commanded("plan", ("area.gpkg", "--prior", "prior.tif", "--swaths", "4", "-o", "route.gpkg"))
        if kind == ".gpkg":
            Path("route.gpkg").rename(out)
        else:
            terrain = ("--dem", "prior.tif") if _knows_all("route.gpkg") else ()
            commanded("export", ("route.gpkg", out, "--area", "area.gpkg", *terrain))

    assert in_copy(messy, tmp_path / "work", of_command)[out] == by_desk[out]


@pytest.mark.long
def test_the_desk_runs_a_mission_as_the_command_does(messy, tmp_path):
    def of_desk() -> None:
        shutil.rmtree("runs")
        mission_run(Path("mine.toml"), None, Job(lambda _: {}))

    def of_command() -> None:
        shutil.rmtree("runs")
        commanded("run", ("mine.toml", "--runs", "runs", "--workers", "1", "-q"))

    assert in_copy(messy, tmp_path / "work", of_desk) == in_copy(messy, tmp_path / "work", of_command)


def test_show_prints_the_lines_of_its_result(messy, monkeypatch):
    monkeypatch.chdir(messy)
    assert (
        commanded("show", ("runs/small/latest",)).splitlines()
        == actions.show(Path("runs/small/latest")).lines()
    )


def test_a_log_is_replayed_as_it_was_written_by_command_and_call(messy, tmp_path):
    def after(replay: Callable[[], object]) -> dict[str, bytes]:
        def work() -> None:
            commanded("watch", DOORS["watch"].words)
            replay()

        return in_copy(messy, tmp_path / "work", work)

    by_command = after(lambda: commanded("watch", ("--replay", "drive.jsonl", "--log", "again.jsonl")))
    request = actions.WatchRequest(replay=Path("drive.jsonl"), log=Path("again.jsonl"))
    assert after(lambda: actions.watch(request)) == by_command
    assert by_command["again.jsonl"] == by_command["drive.jsonl"]


def test_a_dry_run_of_an_upload_prints_the_lines_of_its_preview(messy, monkeypatch):
    monkeypatch.chdir(messy)
    words = ("drawn.geojson", "udp://127.0.0.1:9", "--area", "site.gpkg", "--dry-run")
    request = actions.UploadRequest(
        source=Path("drawn.geojson"), url="udp://127.0.0.1:9", area=Path("site.gpkg")
    )
    assert commanded("upload", words).splitlines() == preview_of(actions.upload, request).lines()


@pytest.mark.long
def test_a_figure_of_a_paper_is_that_of_its_function(messy, tmp_path):
    name = "carving-fig3"
    by_command = in_copy(messy, tmp_path / "work", lambda: commanded("reproduce", (name, "--quick", "-q")))

    def of_call() -> None:
        with replacing_study(Path("results") / name, quick=True) as draft:
            study(name)(draft, quick=True, progress=lambda *_: None)

    assert by_command
    assert in_copy(messy, tmp_path / "work", of_call) == by_command


def test_examples_and_schemas_are_those_of_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commanded("example", ("short_drive",))
    assert Path("short_drive.toml").read_bytes() == (examples_folder() / "short_drive.toml").read_bytes()
    assert json.loads(commanded("schema", ())) == json_schema(MissionConfig, "firnline mission file")


def _knows_all(route: str) -> bool:
    legs = np.vstack([leg.xy for leg in Route.read(route).legs])
    return bool(np.isfinite(Dem.read("prior.tif").at(legs)).all())
