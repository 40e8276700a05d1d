"""Jobs over the server: events, refusals, giving up, the report of a run."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
import shapely

from desk.jobs.job import Job, Jobs
from live.watch.log import line_of, watch_header
from live.watch.survey_watch import SurveyWatch
from planners.guarantee.adaptive import AdaptiveConfig
from survey.core.errors import CapacityError, InputError
from survey.data.route import Leg


def events_of(page, asked):
    """Return the events of a job by its kind, or by its request."""
    job = page.post("/api/jobs", {"kind": asked} if isinstance(asked, str) else asked).json()["job"]
    lines = page.get(f"/api/jobs/{job}/events").text.splitlines()
    return [json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: ")]


def edit(page, **changes):
    state = page.get("/api/plan").json()
    document = {**state["document"], **changes}
    assert (
        page.post(
            "/api/edit", {"revision": state["revision"], "title": "Test", "document": document}
        ).status_code
        == 200
    )


def test_the_curve_falls_with_the_number_of_swaths(page):
    *points, last = events_of(page, "curve")
    assert last["kind"] == "done"
    curve = sorted((point["swaths"], point["rmse_m"]) for point in points)
    assert [error for _, error in curve] == sorted((error for _, error in curve), reverse=True)
    assert [point["swaths"] for point in points if point["is_chosen"]] == [4]


@pytest.mark.long
def test_a_requirement_ends_with_a_plan_or_a_sentence(page):
    edit(page, requirement={"require": "1.5", "probability": 0.8, "surface": "snow", "max_swaths": 12})
    done = events_of(page, "guarantee")[-1]
    assert done["kind"] == "done"
    assert "RMSE" in done["sentence"]
    assert done["command"].startswith(
        "firnline plan hills_area.gpkg --prior hills.tif --require 1.5 --probability 0.8"
    )
    if done["holds"]:
        assert done["planner"]["swaths"] >= 1


def test_what_cannot_be_guaranteed_is_refused_with_what_can_be_reached(page):
    edit(page, requirement={"require": "0.001", "max_swaths": 3})
    done = events_of(page, "guarantee")[-1]
    assert not done["holds"]
    assert "cannot be guaranteed" in done["sentence"]
    assert "they reach" in done["sentence"]


def test_a_requirement_without_a_class_is_refused(page):
    assert "no class is required" in events_of(page, "guarantee")[-1]["error"]


def test_a_wrong_class_is_refused(page):
    edit(page, requirement={"require": "class-9"})
    assert "class-9" in events_of(page, "guarantee")[-1]["error"]


@pytest.mark.long
def test_a_mission_runs_with_its_stages_to_a_report(page, workspace):
    edit(page, planner={"pattern": "lawnmower", "swaths": 2})
    found = events_of(page, "mission")
    assert [event["stage"] for event in found if event["kind"] == "stage"][1:] == [
        "plan",
        "simulate",
        "localize",
        "reconstruct",
        "score",
        "report",
    ]
    check_drive(found)
    done = found[-1]
    assert done["kind"] == "done", done
    assert done["rmse_m"] > 0.0
    report = page.get(done["report"])
    assert report.status_code == 200
    assert "sandbox" in report.headers["content-security-policy"]
    assert (workspace.folder / "hills_mission" / "hills.toml").exists()
    assert page.get(done["report"].replace("index.html", "..%2fmanifest.json")).status_code == 404
    assert Path(done["project"]).suffix == ".qgz"
    (row,) = page.get("/api/runs").json()["runs"]
    assert row["facts"]["RMSE"].startswith(f"{done['rmse_m']:.3f}"[:5])
    for layer in ("error", "sigma", "elevation", "support"):
        picture = page.get(f"/api/runs/{row['name']}/layers/{layer}").json()
        assert picture["image"].startswith("data:image/png;base64,")
        assert len(picture["ends"]) == 2
    assert page.get(f"/api/runs/{row['name']}/minus/{row['name']}").json()["rms_m"] == 0.0
    assert page.get(f"/api/runs/{row['name']}/report/index.html").status_code == 200
    assert page.get(f"/api/runs/{row['name']}/layers/other").status_code == 422
    assert page.get("/api/runs/none/layers/error").status_code == 422
    assert page.post("/api/jobs", {"kind": "replay", "run": "none"}).status_code == 422
    again = events_of(page, {"kind": "replay", "run": row["name"]})
    assert again[-1]["kind"] == "done", again[-1]
    check_drive(again)
    check_drive(events_of(page, "mission"))  # whose stages are all done


def check_drive(events):
    """Check the drive of two swaths, and the map as it grows, in the events of a job."""
    ((driven,),) = [event["rovers"] for event in events if event["kind"] == "driven"]
    assert len(driven["places"]) > 50
    assert len(driven["places"]) == len(driven["true"]) == len(driven["ellipses"]) == len(driven["time_s"])
    assert all(long >= short >= 0.0 for long, short, _ in driven["ellipses"])
    apart_m = np.hypot(*(np.array(driven["places"]) - driven["true"]).T)
    assert 0.0 < apart_m.mean() < 20.0
    assert driven["images"] == []
    grown = [event for event in events if event["kind"] == "grown"]
    assert [event["swaths"] for event in grown] == [1, 2]
    assert driven["time_s"][0] < grown[0]["time_s"] < grown[1]["time_s"] <= driven["time_s"][-1]
    assert grown[0]["rmse_m"] > grown[1]["rmse_m"]
    assert grown[0]["sigma"]["limits"] == grown[1]["sigma"]["limits"]
    assert grown[0]["sigma"]["image"].startswith("data:image/png;base64,")


@pytest.mark.parametrize("body", [{"kind": "shell"}, {}, {"kind": "curve", "path": "/etc"}])
def test_an_unknown_job_is_refused(page, body):
    assert page.post("/api/jobs", body).status_code == 422


def test_a_job_that_does_not_exist_is_refused(page):
    assert page.get("/api/jobs/none/events").status_code == 422
    assert page.delete("/api/jobs/none").status_code == 422


def endless(job: Job) -> dict[str, object]:
    while True:
        job.progress("waiting", 0, 1)
        time.sleep(0.005)


def last_event(job: Job) -> dict[str, object]:
    """Return the last event of a job once it is over."""
    while not job.is_over:
        time.sleep(0.005)
    return job.events()[-1]


def test_a_job_is_given_up_at_its_next_report():
    jobs = Jobs()
    job = jobs.start(endless)
    job.cancel()
    assert last_event(job)["kind"] == "cancelled"


def test_a_few_jobs_run_at_once():
    jobs = Jobs()
    for _ in range(3):
        jobs.start(endless)
    with pytest.raises(CapacityError, match="are running"):
        jobs.start(endless)
    jobs.cancel_all()


def test_a_fault_of_a_job_is_one_sentence(caplog):
    def faulty(job: Job) -> dict[str, object]:
        raise ZeroDivisionError("by zero")

    def refused(job: Job) -> dict[str, object]:
        raise InputError("it is wrong; correct it.")

    jobs = Jobs()
    assert "internal fault, ZeroDivisionError" in last_event(jobs.start(faulty))["error"]
    assert last_event(jobs.start(refused))["error"] == "it is wrong; correct it."


def test_the_log_of_a_watch_is_followed_with_the_map_of_each_update(page, workspace):
    assert "there is no log hills.watch.jsonl" in events_of(page, "watch")[-1]["error"]
    log = workspace.folder / "hills.watch.jsonl"
    log.write_text("{}\n")
    assert "or no log of firnline watch" in events_of(page, "watch")[-1]["error"]
    log.write_text("".join(line_of(entry) for entry in driven_entries(workspace)))
    *events, last = events_of(page, "watch")
    assert (last["kind"], last["sentence"]) == ("done", events[-1].get("text", last["sentence"]))
    assert any("STOP" in event["text"] for event in events if event["kind"] == "watch")
    grown = [event for event in events if event["kind"] == "grown"]
    assert grown[0]["swaths"] == grown[0]["of"] == 2
    assert grown[0]["sigma"]["image"]
    rover = [event for event in events if event["kind"] == "rover"]
    assert [event["time_s"] for event in rover] == sorted(event["time_s"] for event in rover)
    assert rover[-1]["time_s"] >= grown[0]["time_s"] - 60.0
    (west, south), *_ = workspace.store.document.areas[0][0]
    assert np.hypot(rover[0]["place"][0] - west, rover[0]["place"][1] - south - 125.0) < 1.0


def test_maps_of_a_watch_share_their_colours(page, workspace):
    log = workspace.folder / "hills.watch.jsonl"
    log.write_text("".join(line_of(entry) for entry in driven_entries(workspace, limit_m=0.05, n_swaths=4)))
    job = workspace.jobs.find(page.post("/api/jobs", {"kind": "watch"}).json()["job"])
    until = time.monotonic() + 20.0
    while sum(event["kind"] == "grown" for event in job.events()) < 2 and time.monotonic() < until:
        time.sleep(0.02)
    job.cancel()
    first, second = [event for event in job.events() if event["kind"] == "grown"][:2]
    assert first["sigma"]["limits"] == second["sigma"]["limits"]
    assert first["rmse_m"] > second["rmse_m"]


def driven_entries(workspace, limit_m=50.0, n_swaths=2):
    """Yield the inputs of a drive over flat ground, whose map is good enough after two swaths."""
    area = workspace.store.document.survey_area(workspace.crs)
    west, south, east, north = area.bounds
    northings = np.repeat(south + (np.arange(n_swaths) + 0.5) / n_swaths * (north - south), 2)
    eastings = np.resize([west, east, east, west], 2 * n_swaths)
    corners = np.column_stack([eastings, northings])
    legs = [Leg(("swath", "transit")[k % 2], corners[k : k + 2]) for k in range(2 * n_swaths - 1)]
    yield watch_header(SurveyWatch(area, AdaptiveConfig(limit_m, 0.6, noise_m=0.1), legs, every_m=1e9))
    line = shapely.LineString(corners)
    for along in np.arange(0.0, line.length + 1.0, 4.0):
        place = line.interpolate(along)
        height = 100.0 + 0.1 * np.sin(place.x / 50.0)
        yield {"in": "sample", "sample": [along, place.x, place.y, height, 0.05, None]}
