"""A whole mission in images: killed at random it ends with the same products, and faults leave an honest map."""

import os
import random
import signal
import time

import pytest

from sim.config import MissionConfig
from sim.drive import Ending
from sim.mission import run_mission
from sim.runs import open_run
from survey.config import validated
from survey.io.documents import read_json
from tests.reliability.test_same_bytes import Nursery, products

pytestmark = [
    pytest.mark.reliability,
    pytest.mark.slow,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(
        "FIRNLINE_DRIVES" not in os.environ,
        reason="minutes of driving: set FIRNLINE_DRIVES to a number of kills, e.g. 10",
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
SURVEY = {
    "schema_version": 1,
    "name": "faulty",
    "seed": 12,
    "fidelity": "vision",
    "terrain": {"source": "random", "size_m": 100.0, "relief_m": 5.0, "length_scale_m": 40.0},
    "area": {"bounds_m": [526030.0, 6478030.0, 526070.0, 6478070.0]},
    "planner": {"pattern": "lawnmower", "swaths": 4},
    "physics": {"steer_by": "estimate"},
    "imaging": {"width": 320, "height": 240},
    "scenery": {"crevasses_per_ha": 0.0},
    "satellite": {"cell_m": 10.0},
}
FAULTS = {
    "GPS outage": {"component": "gps", "failure": "off", "from_s": 20.0, "until_s": 320.0},
    "whiteout of 60 images": {"component": "camera", "failure": "whiteout", "from_s": 60.0, "until_s": 75.0},
    "slip": {"component": "tracks", "failure": "slippery", "from_s": 50.0, "until_s": 58.0, "strength": 0.15},
    "kidnapped": {"component": "start", "failure": "kidnapped", "strength": 10.0},
}


def test_a_mission_killed_at_random_has_the_same_products(tmp_path):
    (tmp_path / "m.toml").write_text(MISSION)
    nursery = Nursery(tmp_path / "m.toml")
    try:
        began = time.monotonic()
        nursery.start(tmp_path / "whole")
        assert nursery.ended(within_s=900.0) == 0
        whole_s, moments = time.monotonic() - began, random.Random(20261121)
        for _ in range(int(os.environ["FIRNLINE_DRIVES"])):
            child = nursery.start(tmp_path / "killed")
            if nursery.ended(within_s=moments.uniform(0.0, whole_s)) is None:
                os.kill(child, signal.SIGKILL)
                nursery.ended(within_s=60.0)
        nursery.start(tmp_path / "killed")
        assert nursery.ended(within_s=900.0) == 0
    finally:
        nursery.process.stdin.close()
        nursery.process.wait()
        nursery.process.stdout.close()
    assert products(tmp_path / "killed") == products(tmp_path / "whole")


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_leaves_an_honest_map_or_a_named_end(tmp_path, fault):
    mission = validated(MissionConfig, SURVEY | {"faults": [FAULTS[fault]]}, "the test")
    run = open_run(mission, tmp_path)
    run_mission(mission, run, until="score")
    drive = read_json(run.folder("simulate") / "drive.json", "the drive")
    assert drive["ending"] in {ending.value for ending in Ending}
    score = read_json(run.folder("score") / "score.json", "the score")
    if drive["ending"] == Ending.ARRIVED.value:
        # One survey is one draw of what all its landmarks share: an honest map may still hold as little as this.
        assert score["calibration"]["coverage_95"] > 0.7
