"""A whole mission in images, with faults: it ends in a named state, and its path claims what it knows."""

import os
import tomllib

import pytest

from sim.config import MissionConfig
from sim.drive import Ending
from sim.mission import run_mission
from sim.runs import open_run
from survey.config import validated
from survey.io.documents import read_json

pytestmark = [
    pytest.mark.reliability,
    pytest.mark.slow,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(
        "FIRNLINE_DRIVES" not in os.environ,
        reason="minutes of driving: set FIRNLINE_DRIVES=1",
    ),
]

MISSION = """
schema_version = 1
name = "small"
seed = 12
fidelity = "vision"
[terrain]
source = "random"
size_m = 80.0
relief_m = 4.0
length_scale_m = 40.0
[area]
bounds_m = [526025.0, 6478030.0, 526055.0, 6478050.0]
[planner]
pattern = "lawnmower"
swaths = 2
[physics]
steer_by = "estimate"
[imaging]
width = 320
height = 240
[scenery]
crevasses_per_ha = 0.0
[satellite]
cell_m = 10.0
"""
FAULTS = {
    "GPS outage": {"component": "gps", "failure": "off", "from_s": 10.0, "until_s": 310.0},
    "whiteout of 60 images": {"component": "camera", "failure": "whiteout", "from_s": 20.0, "until_s": 35.0},
    "slip": {"component": "tracks", "failure": "slippery", "from_s": 30.0, "until_s": 38.0, "strength": 0.15},
    "kidnapped": {"component": "start", "failure": "kidnapped", "strength": 10.0},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_leaves_an_honest_path_or_a_named_end(tmp_path, fault):
    given = tomllib.loads(MISSION) | {"faults": [FAULTS[fault]]}
    mission = validated(MissionConfig, given, "the test")
    run = open_run(mission, tmp_path)
    run_mission(mission, run, until="score", workers=1)
    drive = read_json(run.folder("simulate") / "drive.json", "the drive")
    assert drive["ending"] in {ending.value for ending in Ending}
    path = read_json(run.folder("score") / "localization.json", "the path")
    if drive["ending"] == Ending.ARRIVED.value:
        # 3 is right on average; one drive is one draw of errors that all its poses share, of 3 degrees of freedom
        # at least, whose squares exceed 16.3 once in a thousand drives.
        assert path["normalised_squared"] < 16.3
