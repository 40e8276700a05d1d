"""Watching a survey: samples that are refused, advice after swaths, replay to the same bytes."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from typer.testing import CliRunner

from firnline.actions.watching import text_of
from firnline.cli.main import app
from live.watch.log import line_of, replayed, watch_header, watch_of
from live.watch.samples import Sample, SampleGate, file_entries
from live.watch.survey_watch import LegProgress, RoverWarnings, SurveyWatch
from planners.guarantee.adaptive import AdaptiveConfig
from planners.prediction.prior_cells import PriorCells
from survey import Dem, Grid, Route, SurveyArea
from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.route import Leg
from survey.data.sensors.records import GpsFixes

CRS = "EPSG:32608"
SIDE_M = 120.0
AREA = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
LIMITS = AdaptiveConfig(0.5, 0.9, noise_m=0.02, sample_step_m=4.0)


def height(xy: np.ndarray) -> np.ndarray:
    return 5.0 * np.sin(xy[:, 0] / 40.0) + 4.0 * np.cos(xy[:, 1] / 35.0) + 100.0


def legs(offsets: tuple[float, ...]) -> list[Leg]:
    found: list[Leg] = []
    for k, y in enumerate(offsets):
        ends = np.array([[2.0, y], [SIDE_M - 2.0, y]])[:: 1 if k % 2 == 0 else -1]
        if found:
            found.append(Leg("transit", [found[-1].xy[-1], ends[0]]))
        found.append(Leg("swath", ends))
    return found


def drive(route: list[Leg], speed_m_s: float = 1.0) -> list[Sample]:
    path = np.vstack([leg.xy for leg in route])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    s = np.arange(0.0, along[-1] + 1.0, 1.0)
    xy = np.column_stack([np.interp(s, along, axis) for axis in path.T])
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(xy))
    rows = zip(s / speed_m_s, xy, height(xy) + noise, strict=True)
    return [
        Sample(float(t), float(x), float(y), float(z), 0.02, 1.0 - 1e-4 * float(t)) for t, (x, y), z in rows
    ]


@pytest.fixture(scope="module")
def watched() -> tuple[SurveyWatch, list[dict], list[str]]:
    planned = legs((10.0, 40.0, 75.0, 110.0))
    watch = SurveyWatch(AREA, LIMITS, planned, every_m=60.0)
    lines, events = [line_of(watch_header(watch))], []
    for sample in drive(planned):
        lines.append(line_of({"in": "sample", "sample": list(sample)}))
        new = watch.take(sample)
        events += new
        lines += [line_of(event) for event in new]
    return watch, events, lines


@pytest.mark.parametrize("grid_m", [None, 7.0])
def test_the_map_covers_an_area_whose_sides_are_no_multiples_of_the_step(grid_m):
    area = SurveyArea.rectangle((0.3, 0.0, 100.3, 73.0), CRS)
    grid = SurveyWatch(area, LIMITS, legs((10.0, 40.0)), grid_m=grid_m).grid
    step_m = grid_m or 100.0 / 60.0
    assert grid.step_m == pytest.approx(step_m)
    assert grid.bounds[:2] == (0.3, 0.0)
    assert 100.3 <= grid.bounds[2] + 1e-6 < 100.3 + step_m
    assert 73.0 <= grid.bounds[3] < 73.0 + step_m


def test_each_swath_is_seen_and_advice_follows_the_second(watched):
    _, events, _ = watched
    assert [event["swaths"] for event in events if event["event"] == "swath"] == [1, 2, 3, 4]
    advice = [event for event in events if event["event"] == "advice"]
    assert len(advice) == 3
    assert advice[-1]["probability"] >= advice[0]["probability"]
    assert {"stop", "drive", "give up"} >= {event["do"] for event in advice}
    maps = [event for event in events if event["event"] == "map"]
    assert maps[-1]["expected_rmse_m"] < maps[0]["expected_rmse_m"]
    assert not [event for event in events if event["event"] in ("refused", "warning")]


def test_the_live_map_follows_the_ground(watched):
    watch, _, _ = watched
    mean, std = watch.map()
    error = mean - height(watch.grid.xy).reshape(watch.grid.shape)
    assert np.sqrt(np.mean(error**2)) < 0.5
    assert np.mean(np.abs(error) < 3.0 * std) > 0.95


def test_the_end_of_a_survey_without_a_class_says_so():
    stop = {
        "event": "advice",
        "time_s": 60.0,
        "limit_m": 1.5,
        "probability": 0.98,
        "do": "stop",
        "class": None,
    }
    assert text_of(stop) == "1 min  STOP: the RMSE of 1.5 m holds with 98%; no class yet"


def test_a_log_replays_to_the_same_bytes(watched, tmp_path):
    _, _, lines = watched
    file = tmp_path / "drive.jsonl"
    file.write_text("".join(lines), encoding="utf-8")
    assert "".join(map(line_of, replayed(file))) == file.read_text(encoding="utf-8")
    assert watch_header(watch_of(json.loads(lines[0]))) == json.loads(lines[0])


def test_a_prior_lowers_the_error_of_the_map_and_is_replayed(tmp_path):
    grid = Grid((-30.0, -30.0, SIDE_M + 30.0, SIDE_M + 30.0), 20.0, CRS)
    cells = height(grid.xy).reshape(grid.shape)
    cells[0, 0] = np.nan
    prior = Dem.on(grid, cells)
    config = replace(LIMITS, cells=PriorCells.of(prior, AREA, 0.3))
    planned = legs((10.0, 40.0))
    errors_m = []
    for settings in ((LIMITS, None), (config, prior)):
        watch = SurveyWatch(AREA, settings[0], list(planned), 60.0, None, settings[1])
        entries = [watch_header(watch)]
        for sample in drive(planned):
            entries += [{"in": "sample", "sample": list(sample)}, *watch.take(sample)]
        mean, _ = watch.map()
        errors_m.append(float(np.sqrt(np.mean(np.square(mean.ravel() - height(watch.grid.xy))))))
        (tmp_path / "drive.jsonl").write_text("".join(map(line_of, entries)), encoding="utf-8")
        assert list(replayed(tmp_path / "drive.jsonl")) == entries
    assert errors_m[1] < 0.5 * errors_m[0]


@pytest.mark.parametrize("has_prior", [False, True])
def test_the_command_watches_a_file_and_replays_its_log(has_prior, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    planned = legs((10.0, 60.0, 110.0))
    Route(tuple(planned), CRS, "lawnmower").write("route.geojson")
    AREA.write("site.gpkg")
    rows = [f"{s.time_s},{s.x_m},{s.y_m},{s.z_m},0.02\n" for s in drive(planned)]
    (tmp_path / "points.csv").write_text(
        "time_s,easting_m,northing_m,elevation_m,sigma_z_m\n" + "".join(rows) + "9"
    )
    nodes = Grid((-30.0, -30.0, SIDE_M + 30.0, SIDE_M + 30.0), 20.0, CRS)
    Dem.on(nodes, height(nodes.xy).reshape(nodes.shape)).write("prior.tif")
    run = ["watch", "points.csv", "--area", "site.gpkg", "--route", "route.geojson", "--require", "0.8"]
    run += ["--prior", "prior.tif"] if has_prior else []
    result = CliRunner().invoke(
        app,
        [
            *run,
            *["--noise", "0.02", "--once", "--log", "a.jsonl", "--next", "next.geojson", "--map", "map.tif"],
        ],
    )
    assert result.exit_code in (0, 5), result.output
    with rasterio.open("map.tif") as written:
        assert written.descriptions == ("elevation", "sigma")
        assert 0.0 < written.read(2).min() < 1.0
    assert "swaths driven" in result.output
    again = CliRunner().invoke(app, ["watch", "--replay", "a.jsonl", "--log", "b.jsonl", "--quiet"])
    assert again.exit_code == result.exit_code, again.output
    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "b.jsonl").read_bytes()
    exported = CliRunner().invoke(app, ["export", "a.jsonl", "drive.mcap"])
    assert exported.exit_code == 0, exported.output
    assert "/map" in exported.output
    assert "/rover1/samples 1" in exported.output


def test_an_incomplete_request_and_a_damaged_log_are_refused(tmp_path):
    assert CliRunner().invoke(app, ["watch"]).exit_code == 4
    (tmp_path / "x.jsonl").write_text("{}\n")
    assert CliRunner().invoke(app, ["watch", "--replay", str(tmp_path / "x.jsonl")]).exit_code == 3


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "has no complete line"),
        ("1 2 3\n", "line 1 is damaged or no JSON"),
        ("[]\n", "line 1: no JSON object"),
        ("[" * 100_000 + "\n", "line 1 is damaged or no JSON (nested deeper"),
        ('{"a":1}\n', "line 1: 'firnline_watch': 1 was expected"),
        ('{"firnline_watch":1}\n', "line 1, is damaged or no survey (it lacks 'no_go')"),
        ("HEADING\n{\n", "line 2 is damaged or no JSON"),
        ('HEADING\n{"in":"sample","sample":[1.0]}\n', "line 2, is damaged or no input of a watch"),
    ],
)
def test_a_damaged_log_is_refused_with_its_line(content, said, tmp_path):
    file = tmp_path / "x.jsonl"
    heading = line_of(watch_header(SurveyWatch(AREA, LIMITS, legs((10.0, 60.0)))))
    file.write_text(content.replace("HEADING\n", heading))
    with pytest.raises(InputError, match=re.escape(said)):
        list(replayed(file))


def test_a_log_that_is_there_outlives_a_source_that_is_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Route(tuple(legs((10.0, 60.0))), CRS, "lawnmower").write("route.geojson")
    AREA.write("site.gpkg")
    (tmp_path / "a.jsonl").write_text("earlier\n")
    run = [
        "watch",
        "missing.csv",
        "--area",
        "site.gpkg",
        "--route",
        "route.geojson",
        "--log",
        "a.jsonl",
        "--force",
    ]
    assert CliRunner().invoke(app, run).exit_code == 3
    assert (tmp_path / "a.jsonl").read_text() == "earlier\n"
    again = CliRunner().invoke(app, ["watch", "--replay", "a.jsonl", "--log", "a.jsonl", "--force"])
    assert again.exit_code == 3
    assert (tmp_path / "a.jsonl").read_text() == "earlier\n"


@pytest.mark.parametrize("option", ["--log", "--next", "--map"])
@pytest.mark.parametrize("name", ["fixes.csv", "site.gpkg", "route.geojson"])
def test_no_output_replaces_an_input(option, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Route(tuple(legs((10.0, 60.0))), CRS, "lawnmower").write("route.geojson")
    AREA.write("site.gpkg")
    (tmp_path / "fixes.csv").write_text("t,x,y,z\n")
    before = (tmp_path / name).read_bytes()
    run = [
        "watch",
        "fixes.csv",
        "--area",
        "site.gpkg",
        "--route",
        "route.geojson",
        option,
        name,
        "--force",
        "--once",
    ]
    result = CliRunner().invoke(app, run)
    assert (result.exit_code, (tmp_path / name).read_bytes()) == (3, before)
    assert f"the output {name} is or contains the input" in " ".join(result.output.split())


def test_a_file_without_a_map_ends_with_the_reason_and_names_itself(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Route(tuple(legs((10.0, 60.0))), CRS, "lawnmower").write("route.geojson")
    AREA.write("site.gpkg")
    (tmp_path / "far.csv").write_text("x,y,z,sigma_z_m\n5,5,100,0.1\n90,90,100,0.1\n5,90,100,0.1\n")
    options = ["--area", "site.gpkg", "--route", "route.geojson", "--once"]
    result = CliRunner().invoke(app, ["watch", "far.csv", *options])
    assert "3 samples, 2 of them refused, 0 swaths driven; no map" in result.output
    (tmp_path / "far.tif").write_text("a\nb\nc\n")
    refused = CliRunner().invoke(app, ["watch", "far.tif", *options])
    assert refused.exit_code == 3
    assert str(tmp_path) not in refused.output.replace(str(tmp_path / "far.tif"), "")
    assert "/tmp" not in refused.output.replace(str(tmp_path), "")


GOOD = Sample(10.0, 50.0, 50.0, 100.0, 0.05)


@pytest.mark.parametrize(
    "bad",
    [
        GOOD._replace(time_s=11.0, x_m=float("nan")),
        GOOD._replace(time_s=11.0, z_m=400.0),
        GOOD._replace(time_s=11.0, y_m=90.0),
        GOOD._replace(time_s=9.0),
        GOOD._replace(time_s=1e9),
        GOOD._replace(time_s=11.0, sigma_m=0.0),
        GOOD._replace(time_s=11.0, sigma_m=4e6),
        GOOD._replace(time_s=11.0, x_m=9e6),
    ],
)
def test_an_impossible_sample_is_refused_and_the_next_good_one_taken(bad):
    gate = SampleGate((-200.0, -200.0, 300.0, 300.0))
    assert gate.reason(GOOD) is None
    assert gate.reason(bad) is not None
    assert gate.reason(GOOD._replace(time_s=12.0, x_m=51.0)) is None


def test_samples_that_agree_with_one_another_are_accepted_after_a_while():
    gate = SampleGate((-200.0, -200.0, 300.0, 300.0))
    gate.reason(GOOD)
    moved = [gate.reason(Sample(11.0 + k, 150.0, 150.0, 130.0, 0.05)) for k in range(8)]
    assert [reason is None for reason in moved] == [False] * 7 + [True]


def test_stuck_silent_and_short_of_charge_are_each_said_once():
    watch = RoverWarnings()
    said = []
    for k in range(300):
        sample = Sample(float(k), min(float(k), 200.0), 0.0, 100.0, 0.05, 0.35 - 0.001 * k)
        said += watch.of(sample, min(float(k), 200.0), False)
    said += watch.silent(320.0) + watch.silent(340.0)
    assert [event["about"] for event in said].count("stuck") == 1
    assert [event["about"] for event in said].count("battery") == 1
    assert [event["about"] for event in said].count("silent") == 1


def test_a_rover_that_waits_for_its_next_swath_is_not_stuck():
    watch, place = RoverWarnings(), Sample(0.0, 5.0, 5.0, 100.0, 0.05)
    waiting = [watch.of(place._replace(time_s=float(t)), 0.0, True) for t in range(300)]
    driving = [watch.of(place._replace(time_s=float(t)), 0.0, False) for t in range(300, 400)]
    assert not any(waiting)
    (first,) = [k for k, events in enumerate(driving) if events]
    assert (first, driving[first][0]["about"]) == (90, "stuck")


def test_a_leg_whose_end_lies_between_two_fixes_is_driven():
    progress = LegProgress(legs((10.0, 40.0, 75.0)), near_m=3.0)
    places = [(2.0, 10.0), (60.0, 10.0), (117.0, 12.0), (118.0, 20.0), (118.0, 39.0), (90.0, 40.0)]
    assert [progress.moved(np.array(place)) for place in places] == [(), (), (0,), (), (1,), ()]
    assert progress.moved(np.array([30.0, 40.0])) == ()
    assert progress.moved(np.array([0.0, 42.0])) == (2,)


def test_a_watch_that_begins_late_finds_the_rover_on_a_later_swath():
    planned = legs((10.0, 40.0, 75.0))
    progress = LegProgress(planned, near_m=3.0)
    late = [sample for sample in drive(planned) if sample.time_s > 60.0]
    done = [progress.moved(np.array([sample.x_m, sample.y_m])) for sample in late]
    assert [legs for legs in done if legs] == [(0, 1, 2), (3,), (4,)]


def test_the_fixes_of_a_growing_recording_are_samples_of_the_ground(tmp_path):
    places = np.column_stack([np.arange(5.0), np.full(5, 3.0), np.full(5, 102.0)])
    fixes = GpsFixes(np.arange(5.0), places, np.full(5, 0.02))
    Recording(CRS, places[0], fixes, antenna_height_m=1.5).write(tmp_path / "drive")
    file = tmp_path / "drive" / "gps.csv"
    file.write_text(file.read_text()[:-4])
    found = [entry["sample"] for entry in file_entries(tmp_path / "drive", AREA.crs, follows=False)]
    assert len(found) == 4
    assert found[0][:5] == pytest.approx([0.0, 0.0, 3.0, 100.5, 0.03])
