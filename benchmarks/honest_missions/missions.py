"""Missions in images on small sites, driven once and stored."""

import os
from dataclasses import replace
from pathlib import Path

from benchmarks.image_surveys import Survey, survey_at
from benchmarks.stored_parts import ROOT
from papers.glacier.surveys import SURVEY
from sim.config.mission import MissionConfig
from sim.config.world import SatelliteConfig
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.world.site import build_world
from survey.core.config import validated
from survey.core.documents import read_json
from survey.data.dem import Dem
from survey.data.recording import Recording
from vision_slam.odometry.onboard import read_visual_odometry

FOLDER = Path(os.environ.get("FIRNLINE_HONEST_MISSIONS", ROOT / "results" / "runs" / "honest-missions"))
SEEDS = tuple(
    int(seed) for seed in os.environ.get("FIRNLINE_HONEST_MISSIONS_SEEDS", "421,422,423,424,425").split(",")
)
PATTERNS = {"lawnmower": 3, "piecewise-continuous": 2}
"""Patterns, and the number of swaths of each."""
SINGLE = 425
"""Seed of the site that is surveyed by a single swath of either pattern."""
PRODUCT = "copernicus-30"
"""Class of product whose errors are drawn and stated in maps with a real prior."""
SIDE_M, EDGE_M, CELL_M = 120.0, 30.0, 15.0
# 40 m between three swaths are the share of it that 150 m are of the 220 m of `examples/mendenhall_like.toml`.
_LENGTH_M, _RELIEF_M = 58.7, 8.0
_WEST, _SOUTH = 526000.0, 6478000.0


def mission_of(pattern: str, seed: int) -> MissionConfig:
    """Return the mission of a pattern and a site: ``examples/mendenhall_like.toml`` at a fifth of its size."""
    bounds = (_WEST + EDGE_M, _SOUTH + EDGE_M, _WEST + EDGE_M + SIDE_M, _SOUTH + EDGE_M + SIDE_M)
    terrain = {"length_scale_m": _LENGTH_M, "size_m": SIDE_M + 2.0 * EDGE_M, "relief_m": _RELIEF_M}
    settings = SURVEY | {
        "name": "honest-mission",
        "seed": seed,
        "terrain": SURVEY["terrain"] | terrain,
        "area": {"bounds_m": bounds},
        "planner": {"pattern": pattern, "swaths": 1 if seed == SINGLE else PATTERNS[pattern]},
        "satellite": {"cell_m": CELL_M},
    }
    return validated(MissionConfig, settings, "the mission")


def driven(pattern: str, seed: int) -> Path:
    """Return the folder of a mission; it is driven where that was not done before.

    A recording that is there is taken whatever settings missions have gained since.
    """
    place = FOLDER / f"{pattern}-{seed}"
    if not place.exists():
        mission = mission_of(pattern, seed)
        run = open_run(mission, FOLDER / "runs")
        run_mission(mission, run, until="simulate", workers=1)
        place.symlink_to(run.path.resolve(), target_is_directory=True)
    return place


def survey_of(pattern: str, seed: int) -> Survey:
    """Return the recording of a mission with its truth, and its cells without common errors."""
    folder = driven(pattern, seed)
    recording = Recording.read(folder / "2-simulate" / "recording")
    return survey_at(folder, recording, read_visual_odometry(folder / "2-simulate" / "recording" / "onboard"))


def ending_of(pattern: str, seed: int) -> str:
    """Return how the drive of a mission ended; ``arrived`` is the one wanted."""
    return str(read_json(driven(pattern, seed) / "2-simulate" / "drive.json", "the drive")["ending"])


def real_prior(pattern: str, seed: int) -> Dem:
    """Return cells of a site with the errors of a class of products, as a mission draws them."""
    satellite = SatelliteConfig(product=PRODUCT, cell_m=CELL_M)
    return build_world(mission_of(pattern, seed).model_copy(update={"satellite": satellite})).prior


def without_stakes(survey: Survey) -> Survey:
    """Return a survey of which nobody surveyed the stakes."""
    return replace(survey, recording=replace(survey.recording, stakes=None, stake_sightings=None))
