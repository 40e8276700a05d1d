"""Sections of the page for several rovers, a science payload and hazards."""

import re
from dataclasses import replace

import numpy as np
import pytest

from survey import Dem
from survey.data.sensors.payload import Quantity
from survey.reporting.page import fleet_rows, payload_rows, write_report
from survey.reporting.survey_results import FleetResults, HazardResults, PayloadResults, RoverDrive
from tests.survey.reporting.test_page import Outline, surveyed

WARM = Quantity(name="air_temperature", unit="degC", noise_sd=0.1)
FITTED = {
    "length_scale_m": 60.0,
    "per_km_of_elevation": -6.4,
    "per_km_of_elevation_sigma": 0.5,
    "noise_sd": 0.1,
}


def rover(site, ending: str) -> RoverDrive:
    return RoverDrive(
        trajectory=site.trajectory,
        reference_trajectory=site.reference_trajectory,
        ending=ending,
        duration_s=900.0,
        energy_j=450_000.0,
        horizontal_rms_m=0.4,
        vertical_rms_m=0.2,
        n_ties=3,
    )


@pytest.fixture(scope="module")
def fleet(site) -> FleetResults:
    losses = {"swaths_not_driven_m": 0.0, "extra_length_m": 120.0, "extra_time_s": 300.0}
    return FleetResults(rovers=(rover(site, "arrived"), rover(site, "stalled")), losses=losses)


@pytest.fixture(scope="module")
def payload(site) -> PayloadResults:
    mapped = replace(site.reconstruction, quantity="air_temperature_degC", hyperparameters=FITTED)
    scores = {"rmse": 0.2, "coverage_95": 0.94, "claimed_rms": 0.21, "scc": 0.5}
    return PayloadResults(quantity=WARM, mapped=mapped, scores=scores)


def test_the_table_of_rovers_has_time_energy_and_ending(fleet, site):
    heading, first, second = fleet_rows(fleet, site.route)
    assert len(heading) == len(first) == len(second)
    assert second[5] == "stalled"
    assert first[3].split() == ["900", "s"]
    assert first[4].split() == ["450", "kJ"]
    assert first[-1] == "3"
    assert fleet_rows(None, site.route) == []


def test_the_table_of_quantities_has_length_scale_and_scores(payload):
    heading, row = payload_rows((payload,))
    assert len(heading) == len(row)
    assert row[0] == "Air temperature [degC]"
    assert row[1].split() == ["60", "m"]
    assert "94.0%" in row
    assert payload_rows(()) == []


@pytest.mark.long
def test_the_page_shows_rovers_payload_and_hazards(tmp_path, site, scored, fleet, payload):
    probability = Dem.on(site.grid, np.full(site.grid.shape, 0.1))
    facts = {"no_go_share": 0.02, "route_worst_probability": 0.4}
    results = replace(
        surveyed(site, scored),
        trajectory=None,
        reference_trajectory=None,
        fleet=fleet,
        payload=(payload,),
        hazard=HazardResults(probability=probability, max_slope_deg=15.0, facts=facts),
    )
    page = write_report(tmp_path / "report", results, title="Two rovers").read_text(encoding="utf-8")
    outline = Outline(page)
    assert outline.open == []
    figures = {path.stem for path in (tmp_path / "report" / "figures").iterdir()}
    own = {
        "rover_1_path",
        "rover_2_path_error",
        "payload_air_temperature",
        "payload_air_temperature_std",
        "hazard",
    }
    assert own <= figures
    assert len(outline.all("img")) == len(figures)
    for words in ("Rovers", "Loss of rovers", "Quantities", "Hazards for the next plan"):
        assert words in page
    assert not re.search(r"https?://", page)
