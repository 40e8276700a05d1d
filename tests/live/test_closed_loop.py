"""From plan to stop over the link: upload and start, telemetry of the simulated rover, watch, next swath, until stopped."""

import json
from contextlib import closing

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from live.link import LinkAddress, Vehicle
from live.mission.items import AutopilotMission
from live.mission.vehicle_mission import upload
from live.watch.log import entered, heading_of, legs_as_lists, line_of, replayed
from live.watch.samples import TelemetryReader, buffered_entries, telemetry_entries
from live.watch.survey_watch import SurveyWatch
from planners.guarantee.adaptive import AdaptiveConfig
from survey import Dem, Grid, Route, SurveyArea
from survey.data.route import Leg
from survey.interchange.missions import Surroundings

CRS, WEST, SOUTH, SIDE_M = "EPSG:32608", 526_000.0, 6_478_000.0, 100.0
AREA = SurveyArea.rectangle((WEST, SOUTH, WEST + SIDE_M, SOUTH + SIDE_M), CRS)


def write_ground(path) -> None:
    grid = Grid((WEST - 20.0, SOUTH - 20.0, WEST + SIDE_M + 20.0, SOUTH + SIDE_M + 20.0), 5.0, CRS)
    east, north = (grid.xy - [WEST, SOUTH]).T
    heights = 900.0 + 4.0 * np.sin(east / 45.0) + 3.0 * np.cos(north / 40.0)
    Dem.on(grid, heights.reshape(grid.shape)).write(path)


def first_legs() -> list[Leg]:
    one = np.array([[WEST + 2.0, SOUTH + 15.0], [WEST + 98.0, SOUTH + 15.0]])
    other = np.array([[WEST + 98.0, SOUTH + 60.0], [WEST + 2.0, SOUTH + 60.0]])
    return [Leg("swath", one), Leg("transit", [one[1], other[0]]), Leg("swath", other)]


@pytest.mark.long
@pytest.mark.timeout(300)
def test_the_survey_is_driven_swath_by_swath_until_it_is_stopped(start_rover, tmp_path):
    write_ground(tmp_path / "ground.tif")
    rover = start_rover("--dem", str(tmp_path / "ground.tif"), "--hasten", "12")
    address = LinkAddress.parsed(rover.url)
    config = AdaptiveConfig(0.6, 0.9, noise_m=0.05, sample_step_m=4.0)
    watch = SurveyWatch(AREA, config, first_legs(), every_m=1e9)
    log, legs = [line_of(heading_of(watch))], watch.legs.copy()
    while legs:
        route = Route(tuple(legs), CRS, "adaptive")
        upload(AutopilotMission.of_route(route, Surroundings(AREA)), address, patience_s=60.0, starts=True)
        legs = driven(address, watch, log)
    assert watch.is_stopped
    assert watch.advice.is_met
    (tmp_path / "drive.jsonl").write_text("".join(log), encoding="utf-8")
    assert "".join(map(line_of, replayed(tmp_path / "drive.jsonl"))) == "".join(log)
    mean, _ = watch.map()
    truth = Dem.read(tmp_path / "ground.tif").at(watch.grid.xy).reshape(watch.grid.shape)
    assert np.sqrt(np.nanmean((mean - truth) ** 2)) < 0.6


def driven(address: LinkAddress, watch: SurveyWatch, log: list[str]) -> list[Leg]:
    """Follow the telemetry until an advice comes after the last leg; return the legs to drive next."""
    reader = TelemetryReader(AREA.crs)
    with (
        Vehicle.connected(address, 60.0) as vehicle,
        closing(buffered_entries(vehicle, reader)) as entries,
    ):
        for entry in entries:
            events = entered(watch, entry)
            log += [line_of(one) for one in (entry, *events)]
            if watch.progress.n_driven == len(watch.legs):
                break
    legs = list(watch.advice.legs)
    if legs:
        entry = {"in": "legs", "legs": legs_as_lists(legs)}
        entered(watch, entry)
        log.append(line_of(entry))
    return legs


def test_the_command_uploads_and_starts(start_rover, tmp_path):
    rover = start_rover("--hasten", "5")
    Route(tuple(first_legs()), CRS, "two").write(tmp_path / "route.geojson")
    result = CliRunner().invoke(
        app, ["upload", str(tmp_path / "route.geojson"), rover.url, "--start", "--json", "-q"]
    )
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["items"] == 4
    with Vehicle.connected(LinkAddress.parsed(rover.url), 60.0) as vehicle:
        entries = telemetry_entries(vehicle, TelemetryReader(AREA.crs))
        samples = [entry["sample"] for entry in (next(entries) for _ in range(12)) if entry["in"] == "sample"]
    assert samples[-1][1] > samples[0][1] + 1.0
