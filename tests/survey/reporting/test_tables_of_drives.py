"""Tables of the rovers of a fleet and of the quantities of a payload."""

import numpy as np
import pytest

from survey.data.route import Leg, Route
from survey.data.trajectory import Trajectory
from survey.reporting.page import FLEET_HEADINGS, fleet_rows, payload_rows
from survey.reporting.survey_results import FleetResults, RoverDrive

CRS = "EPSG:32608"


def straight(length_m):
    position = np.array([[0.0, 0.0, 0.0], [length_m, 0.0, 0.0]])
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    return Trajectory([0.0, 60.0], position, turn, np.zeros((2, 3, 3)), CRS)


@pytest.fixture
def route():
    legs = (
        Leg("swath", [[0.0, 0.0], [100.0, 0.0]]),
        Leg("transit", [[100.0, 0.0], [100.0, 10.0]]),
        Leg("swath", [[100.0, 10.0], [0.0, 10.0]]),
        Leg("swath", [[0.0, 20.0], [100.0, 20.0]], 1),
    )
    return Route(legs, CRS, "lawnmower", 10.0)


def test_each_rover_has_a_row_with_its_swaths_and_its_driven_distance(route):
    rovers = tuple(
        RoverDrive(
            trajectory=straight(length),
            reference_trajectory=straight(length),
            ending=ending,
            duration_s=60.0,
            energy_j=2500.0,
            horizontal_rms_m=error,
        )
        for length, ending, error in ((200.0, "arrived", 0.25), (40.0, "stalled", None))
    )
    heading, first, second = fleet_rows(FleetResults(rovers=rovers), route)
    assert heading == list(FLEET_HEADINGS)
    assert [cell.replace("\u00a0", " ") for cell in first] == [
        "Rover 1", "2", "200 m", "60 s", "2 kJ", "arrived", "0.25 m", "–", "0",
    ]  # fmt: skip
    assert second[:3] == ["Rover 2", "1", "40\u00a0m"]
    assert second[5:] == ["stalled", "–", "–", "0"]


def test_a_survey_without_fleet_or_payload_has_no_rows(route):
    assert fleet_rows(None, route) == []
    assert payload_rows([]) == []
