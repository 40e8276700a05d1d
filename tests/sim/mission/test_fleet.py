"""Missions of several rovers: a drive of each, one map of all, and what a loss leaves."""

import filecmp
from pathlib import Path

import numpy as np
import pytest

from benchmarks.small_inputs import BARE_SCENERY
from sim.config.mission import MissionConfig
from sim.mission.drives import simulate_drive
from sim.mission.fleet import (
    LOSS_FILE,
    accounts,
    drive_fleet,
    drive_folders,
    n_lost,
    n_ties,
    route_of,
)
from sim.mission.localization import mapped_points
from sim.mission.losses import with_drawn_losses
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.world.site import build_world
from survey import Reconstruction, Route, Score, SurfacePoints, Trajectory
from survey.core.config import validated
from survey.core.documents import read_json
from survey.core.errors import ConfigError, InputError
from survey.core.run_folder import RunFolder
from survey.data.recording import Recording

STOPPED = {"component": "tracks", "failure": "stopped", "from_s": 150.0, "rover": 2}
TWO = {
    "schema_version": 1,
    "name": "two",
    "fidelity": "statistical",
    "terrain": {"source": "random", "size_m": 150.0, "step_m": 3.0, "origin_m": (500000.0, 6700000.0)},
    "area": {"starts_m": ((500010.0, 6700010.0),)},
    "planner": {"pattern": "lawnmower", "swaths": 4},
    "fleet": {"rovers": 2},
    "reconstruction": {
        "grid_step_m": 5.0,
        "gp": {"fit": False, "variance_m2": 25.0, "length_scale_m": 40.0, "calibrate": False},
    },
}


def mission(**changes: object) -> MissionConfig:
    return validated(MissionConfig, TWO | changes, "the test")


def run_of(config: MissionConfig, folder: Path, until: str) -> RunFolder:
    run = open_run(config, folder)
    run_mission(config, run, until=until, workers=1)
    return run


def bytes_agree(first: Path, second: Path) -> bool:
    files = [file.relative_to(first) for file in first.rglob("*") if file.is_file()]
    assert files
    return not any(filecmp.cmpfiles(first, second, [str(file) for file in files], shallow=False)[1:])


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return run_of(mission(), tmp_path_factory.mktemp("fleet"), "score")


def test_every_rover_has_a_drive_and_all_have_one_map(surveyed):
    for stage in ("simulate", "localize", "score"):
        assert [place.name for place in drive_folders(surveyed.folder(stage))] == ["rover-01", "rover-02"]
    assert {account["ending"] for account in accounts(surveyed.folder("simulate"))} == {"arrived"}
    assert not (surveyed.folder("simulate") / LOSS_FILE).exists()
    mapped = Reconstruction.read(surveyed.folder("reconstruct"))
    seen = [
        len(SurfacePoints.read(place / "surface_points.gpkg"))
        for place in drive_folders(surveyed.folder("localize"))
    ]
    assert mapped.diagnostics["n_points"] == sum(seen)
    score = Score.from_dict(read_json(surveyed.folder("score") / "score.json", "the score"))
    assert score.elevation.rmse_m < 0.5


def test_the_first_rover_records_what_a_single_one_would(surveyed, tmp_path):
    world, config = build_world(mission()), mission()
    route = Route.read(surveyed.folder("plan") / "route.geojson")
    simulate_drive(world, route_of(route, 0), config, tmp_path)
    assert bytes_agree(tmp_path / "recording", surveyed.folder("simulate") / "rover-01" / "recording")


def test_rovers_have_errors_of_their_own(surveyed):
    first, second = (
        Recording.read(place / "recording").gps for place in drive_folders(surveyed.folder("simulate"))
    )
    n = min(len(first), len(second), 200)
    one, two = (np.diff(gps.position[:n, 2]) for gps in (first, second))
    assert abs(np.corrcoef(one, two)[0, 1]) < 0.3


def test_the_swaths_of_a_lost_rover_are_driven_by_the_others(tmp_path):
    config = mission(faults=(STOPPED,), fleet={"rovers": 2, "on_loss": "replan"})
    run = run_of(config, tmp_path, "simulate")
    planned = Route.read(run.folder("plan") / "route.geojson")
    driven = Route.read(run.folder("simulate") / "driven_route.geojson")
    assert sum(leg.length_m for leg in driven.swaths) == pytest.approx(
        sum(leg.length_m for leg in planned.swaths)
    )
    first, second = accounts(run.folder("simulate"))
    assert (first["ending"], second["ending"]) == ("arrived", "stalled")
    assert second["progress_m"] == pytest.approx(150.0)
    losses = read_json(run.folder("simulate") / LOSS_FILE, "the losses")
    assert losses["swaths_not_driven_m"] == pytest.approx(0.0, abs=1e-6)
    assert losses["extra_time_s"] > 100.0


def test_a_loss_without_replanning_leaves_a_gap_that_is_stated(tmp_path):
    run = run_of(mission(faults=(STOPPED,)), tmp_path, "simulate")
    losses = read_json(run.folder("simulate") / LOSS_FILE, "the losses")
    assert losses["swaths_not_driven_m"] == pytest.approx(losses["lost"][0]["swaths_left_m"])
    assert losses["swaths_not_driven_m"] > 50.0


def test_a_single_rover_that_stops_leaves_an_account(tmp_path):
    config = mission(faults=(STOPPED | {"rover": 1},), fleet={"rovers": 1})
    run = run_of(config, tmp_path, "simulate")
    (account,) = accounts(run.folder("simulate"))
    assert account["ending"] == "stalled"
    assert account["progress_m"] == pytest.approx(150.0)
    driven = Route.read(run.folder("simulate") / "driven_route.geojson")
    assert driven.length_m == pytest.approx(150.0)
    assert n_lost(run.folder("simulate")) == 1


def test_losses_are_drawn_with_their_probability(surveyed):
    route = Route.read(surveyed.folder("plan") / "route.geojson")
    drawn = [
        len(with_drawn_losses(route, mission(seed=seed, fleet={"rovers": 2, "loss_probability": 0.3})).faults)
        for seed in range(200)
    ]
    assert np.mean(drawn) == pytest.approx(0.6, abs=0.15)
    assert with_drawn_losses(route, mission()).faults == ()


def test_a_rover_that_stops_before_it_records_is_refused(tmp_path):
    with pytest.raises(InputError, match="before it has recorded"):
        run_of(mission(faults=(STOPPED | {"from_s": 1.0},)), tmp_path, "simulate")


def test_faults_and_settings_that_no_rover_can_have_are_refused():
    with pytest.raises(ConfigError, match="rover 3"):
        mission(faults=(STOPPED | {"rover": 3},))
    with pytest.raises(ConfigError, match="battery"):
        mission(fleet={"rovers": 2, "on_loss": "replan"}, rover={"battery_j": 1e9})


@pytest.mark.long
@pytest.mark.slow
def test_rovers_side_by_side_write_the_same_bytes_as_in_turn(surveyed, tmp_path):
    config = mission()
    route = Route.read(surveyed.folder("plan") / "route.geojson")
    drive_fleet(build_world(config), route, config, tmp_path, 2)
    assert bytes_agree(tmp_path, surveyed.folder("simulate"))


@pytest.mark.parametrize(
    ("limits", "slope_deg"),
    [({"max_pitch_deg": 20.0}, 20.0), ({"max_step_m": 2.0 * np.tan(0.2)}, np.degrees(0.2))],
)
def test_steep_ground_is_marked_for_the_next_plan(limits, slope_deg, tmp_path):
    run = run_of(mission(rover=limits, fleet={"rovers": 1}), tmp_path, "reconstruct")
    place = run.folder("reconstruct") / "hazards"
    facts = read_json(place / "hazard.json", "the hazards")
    assert facts["max_slope_deg"] == pytest.approx(slope_deg)
    assert 0.0 <= facts["route_worst_probability"] <= 1.0
    assert (place / "hazard.tif").exists()
    assert (place / "next_area.gpkg").exists()


def in_images(**changes: object) -> MissionConfig:
    """Return a mission of two rovers with small images on 14 × 14 m."""
    sections = {
        "fidelity": "vision",
        "terrain": TWO["terrain"] | {"size_m": 30.0, "step_m": 0.5, "relief_m": 1.0},
        "area": {
            "bounds_m": (500008.0, 6700008.0, 500022.0, 6700022.0),
            "starts_m": ((500009.0, 6700009.0),),
        },
        "satellite": {"cell_m": 10.0},
        "planner": {"pattern": "lawnmower", "swaths": 2},
        "rover": {"mass_kg": 18.0, "idle_w": 20.0},
        "scenery": BARE_SCENERY,
        "imaging": {"width": 96, "height": 72},
        "physics": {"engine": "kinematic"},
    }
    return mission(**sections | changes)


@pytest.mark.long
@pytest.mark.slow
def test_rovers_in_images_share_one_map_that_holds_the_ground(tmp_path):
    # At 128 × 96 pixels one image in six shows enough of the ground to follow, and one landmark passes the gates.
    run = run_of(in_images(imaging={"width": 160, "height": 120}), tmp_path, "score")
    assert [one["ending"] for one in accounts(run.folder("simulate"))] == ["arrived", "arrived"]
    localized, mapped = run.folder("localize"), run.folder("reconstruct")
    n_landmarks = [len(mapped_points(place)) for place in drive_folders(localized)]
    facts = Reconstruction.read(mapped)
    assert facts.diagnostics["n_points"] == sum(n_landmarks)
    assert min(n_ties(localized, 2)) > 0
    for place in drive_folders(mapped):
        assert Trajectory.read(place / "corrected_trajectory.csv", "EPSG:32608").error is None
    score = read_json(run.folder("score") / "score.json", "the score")
    assert facts.claim is not None
    # Nine nodes share one level error, so their number within the interval says little.
    assert score["elevation"]["rmse_m"] < facts.claim.absolute.upper_m < 0.5


@pytest.mark.exhaustive
@pytest.mark.slow
def test_rovers_drive_with_images_and_one_that_stalls_is_replaced(tmp_path):
    config = in_images(faults=(STOPPED | {"from_s": 12.0},), fleet={"rovers": 2, "on_loss": "replan"})
    run = run_of(config, tmp_path, "simulate")
    folder = run.folder("simulate")
    first, second = accounts(folder)
    assert (first["ending"], second["ending"]) == ("arrived", "stalled")
    assert second["progress_m"] < 14.0
    planned = Route.read(run.folder("plan") / "route.geojson")
    driven = Route.read(folder / "driven_route.geojson")
    left_m = read_json(folder / LOSS_FILE, "the losses")["lost"][0]["swaths_left_m"]
    assert sum(leg.length_m for leg in driven.swaths) == pytest.approx(
        sum(leg.length_m for leg in planned.swaths)
    )
    assert left_m > 0.0
    images = [Recording.read(place / "recording").frames for place in drive_folders(folder)]
    assert min(len(frames) for frames in images) > 20
    assert not np.array_equal(images[0][5], images[1][5])
