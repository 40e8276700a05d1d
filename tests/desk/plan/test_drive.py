"""Drive of a plan in time."""

import numpy as np
import pytest

from desk.plan.summary import drives
from tests.desk.conftest import SOUTH, WEST

START = ((WEST + 210.0, SOUTH + 210.0),)


def made(workspace, **changes):
    document = workspace.store.document.model_copy(update=changes)
    live = workspace.planner.quick(document)
    return live.plan.route.prediction, drives(live, workspace.tiles.pyramid)


def test_the_drive_ends_with_the_time_and_energy_of_the_plan(workspace):
    facts, (drive,) = made(workspace)
    assert drive["time_s"][-1] == pytest.approx(facts["time_s"], rel=2e-3)
    assert drive["energy_j"][-1] == pytest.approx(facts["energy_j"], rel=5e-3)
    assert drive["distance_m"][-1] == pytest.approx(facts["length_m"], rel=1e-3)
    assert drive["battery_share"] is None
    assert len(drive["places"]) == len(drive["time_s"]) == len(drive["heights_m"])


def test_swaths_are_parts_of_the_drive(workspace):
    _, (drive,) = made(workspace)
    assert len(drive["swaths"]) == 4
    first, last = drive["swaths"][0]
    ends = np.array([drive["places"][first], drive["places"][last]])
    assert np.hypot(*(ends[1] - ends[0])) == pytest.approx(500.0, abs=1.0)


def test_a_battery_is_full_after_each_visit_to_the_depot(workspace):
    settings = {"battery_j": 1.1e6, "recharge_s": 600.0}
    facts, (drive,) = made(workspace, starts=START, rover=settings)
    assert facts["n_recharges"] >= 1
    share = np.array(drive["battery_share"])
    assert share[0] == 1.0
    assert (np.diff(share) > 0).sum() == facts["n_recharges"]
    assert share.min() >= 0.0
    assert drive["time_s"][-1] == pytest.approx(facts["time_s"], rel=2e-3)


def test_rovers_that_wait_depart_later(workspace):
    facts, (first, second) = made(workspace, starts=START, fleet={"rovers": 2, "separation_m": 20.0})
    assert first["time_s"][0] == facts["wait_s_rover_0"]
    assert second["time_s"][0] == facts["wait_s_rover_1"]
