"""A mission in images: killed at random it ends with the same products, and faults leave an honest path."""

import os
import random
import time
import tomllib
from pathlib import Path

import pytest

from benchmarks.fork_server import ForkServer
from sim.config.mission import MissionConfig
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.simulate.simulated_drive import Ending
from survey.core.config import validated
from survey.core.documents import read_json
from tests.reliability.test_same_bytes import products, whole_run

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
[scenery]
crevasses_per_ha = 0.0
[satellite]
cell_m = 10.0
"""
# Half a minute: two swaths of 20 m and what joins them, seen by a coarse camera.
SMALL = (
    MISSION.replace("526055.0, 6478050.0", "526045.0, 6478044.0") + "[imaging]\nwidth = 320\nheight = 240\n"
)
# As many images for each metre, so that 300 s end before the drive does.
SLOW = {
    "rover": {"speed_m_s": 0.2},
    "physics": {"steer_by": "estimate", "max_turn_rate_rad_s": 0.2},
    "instruments": {"frame_rate_hz": 1.0},
}
FAULTS = {
    "GPS outage": {"component": "gps", "failure": "off", "from_s": 20.0, "until_s": 320.0},
    "whiteout of 60 images": {"component": "camera", "failure": "whiteout", "from_s": 20.0, "until_s": 35.0},
    "slip": {"component": "tracks", "failure": "slippery", "from_s": 30.0, "until_s": 38.0, "strength": 0.15},
    "started elsewhere": {"component": "start", "failure": "kidnapped", "strength": 10.0},
    "carried with all off": {"component": "rover", "failure": "carried", "from_s": 20.0, "until_s": 30.0},
}


def test_a_mission_killed_at_random_has_the_same_products(tmp_path):
    (tmp_path / "m.toml").write_text(SMALL)
    with ForkServer(tmp_path) as server:
        began = time.monotonic()
        expected = whole_run(server, tmp_path / "whole", within_s=1200.0)
        whole_s, moments = time.monotonic() - began, random.Random(20261121)
        kills = 0
        while kills < int(os.environ["FIRNLINE_DRIVES"]):
            run = server.start(f"run m.toml --runs {tmp_path / 'killed'} -q")
            if server.ended(within_s=moments.uniform(0.0, 0.9) * whole_s) is not None:
                # It came to its end first: the next kills hit a new run of the same mission.
                assert products(tmp_path / "killed") == expected
                (tmp_path / "killed").rename(tmp_path / f"done-{kills}")
                continue
            computers = onboard_computers(run) if kills % 2 else []
            # Without its computer a run ends by itself, and names why.
            assert server.killed(computers[0] if computers else run) != 0
            kills += 1
        assert whole_run(server, tmp_path / "killed", within_s=1200.0) == expected
    assert not [p for p in (tmp_path / "killed").rglob("*") if p.name.endswith(".partial")]


def onboard_computers(run: int) -> list[int]:
    """Return the process ids of what a run has started beside itself to look at images."""
    children = Path(f"/proc/{run}/task/{run}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_leaves_an_honest_path_and_map_or_a_named_end(tmp_path, fault):
    slow = SLOW if fault == "GPS outage" else {}
    given = tomllib.loads(MISSION) | slow | {"faults": [FAULTS[fault]]}
    mission = validated(MissionConfig, given, "the test")
    run = open_run(mission, tmp_path)
    run_mission(mission, run, until="score", workers=1)
    drive = read_json(run.folder("simulate") / "drive.json", "the drive")
    assert drive["ending"] in {ending.value for ending in Ending}
    score = read_json(run.folder("score") / "score.json", "the score")
    path = read_json(run.folder("score") / "localization.json", "the path")
    if drive["ending"] == Ending.ARRIVED.value:
        assert drive["duration_s"] > FAULTS[fault].get("until_s", 0.0)
        # 3 is right on average; one drive is one draw of errors that all its poses share, of 3 degrees of freedom
        # at least, whose squares exceed 16.3 once in a thousand drives.
        assert path["normalised_squared"] < 16.3
        # All of so small a map is too high or too low together: one draw as well, beyond 3 σ once in 370 surveys.
        # The share of the ground within 95 % would be near 1 or near 0 from one honest survey to the next.
        assert score["calibration"]["z_rms"] < 3.0
