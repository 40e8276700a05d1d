"""Error and coverage of a joint estimate of map and path with landmarks from images: missions of 2.85 km.

Run with ``python -m benchmarks.joint_mapping_images``. The drives are the lawnmower missions of
``benchmarks.vision_mission``, with seeds that no setting was chosen on (``FIRNLINE_SURVEY_SEEDS=71,72`` takes fewer);
what the rover's computer made of the images is read, and not done again. On every drive a receiver of either memory is
simulated again. The cases are those of ``benchmarks.joint_mapping``, but for gravity: the odometry of images is levelled by it
in all of them. No error is debiased, and no place is recognised. Beside them stands what the landmarks give on the path
that was really driven: no estimate of the path can map the gaps between the swaths better.
"""

import os
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from benchmarks.image_surveys import (
    Outcome,
    Profile,
    Survey,
    fixes_along,
    judged,
    on_the_real_path,
    rows_of,
)
from benchmarks.report import Row, main
from benchmarks.vision_mission import LASTING, survey_of
from survey.core.errors import CapacityError
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.prior import SatelliteErrors
from vision_slam import localize

SEEDS = tuple(int(seed) for seed in os.environ.get("FIRNLINE_SURVEY_SEEDS", "71,72,73").split(","))
STATED = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=1.0), bow_sigma_deg=0.3)
"""Landmarks of the development surveys rose by 0.15 to 0.3 degrees ahead, and sank by up to 0.15 aside."""
PROFILES: dict[str, Profile] = {"tau 60 s": "gauss-markov-60", "tau 300 s": "gauss-markov-300"}
_OTHERS = ("inertial", "barometer", "base_barometer", "stakes", "stake_sightings")
_STAKES = ("stakes", "stake_sightings")


@dataclass(frozen=True)
class Case:
    """What is left out of a recording, and how it is mapped."""

    name: str
    errors: Literal["independent", "inflated", "joint"] = "joint"
    satellite: bool = True
    without: tuple[str, ...] = _OTHERS


CASES = (
    Case("per-landmark noise", "independent", satellite=False),
    Case("inflated noise", "inflated", satellite=False),
    Case("joint", satellite=False),
    Case("joint + satellite"),
    Case("+ gyro, barometer", without=_STAKES),
    Case("+ 4 stakes", without=()),
)


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    surveys = [survey_of("lawnmower", seed, quick=quick) for seed in (SEEDS[:1] if quick else SEEDS)]
    yield Row("landmarks, fewest", float(min(len(s.found.sightings.pose) for s in surveys)), "1")
    yield from rows_of("landmarks placed by the real path", [_floor(survey) for survey in surveys])
    for name, profile in list(PROFILES.items())[: 1 if quick else None]:
        drawn = [_outcomes(survey, profile, draw) for draw, survey in enumerate(surveys)]
        for case in CASES:
            done = [found[case.name] for found in drawn if case.name in found]
            yield Row(f"{case.name}, {name}: surveys that it maps", float(len(done)), "1")
            if done:
                yield from rows_of(f"{case.name}, {name}", done)
        first, fourth = CASES[0].name, CASES[3].name
        gains = [found[first].rmse_m / found[fourth].rmse_m for found in drawn if first in found]
        if gains:
            yield Row(f"{name}: per-landmark noise / joint + satellite, median", float(np.median(gains)), "x")


def _outcomes(survey: Survey, profile: Profile, draw: int) -> dict[str, Outcome]:
    """Localize a survey with a receiver of its own luck, once for all cases that leave out the same, and map it.

    Landmarks that claim to be independent, on swaths that contradict each other, may have no map that settles.
    """
    fixes, paths = fixes_along(survey, profile, 1000 + draw), dict[tuple[str, ...], Any]()
    outcomes = {}
    for case in CASES:
        if case.without not in paths:
            kept: dict[str, Any] = {"gps": fixes, "base": None} | dict.fromkeys(case.without)
            paths[case.without] = localize(replace(survey.recording, **kept), LASTING, visual=survey.found)
        trajectory, points = paths[case.without].trajectory, paths[case.without].points
        with suppress(CapacityError) if case.errors != "joint" else nullcontext():
            outcomes[case.name] = _mapped(survey, case, trajectory, points)
    return outcomes


def _mapped(survey: Survey, case: Case, trajectory: Trajectory, points: SurfacePoints) -> Outcome:
    prior = survey.prior if case.satellite else None
    learned = GaussianProcessConfig()
    if case.errors == "joint":
        assert trajectory.error is not None
        found = JointTerrain(trajectory.error, prior, learned, STATED).map(points, survey.nodes)
        return judged(found.reconstruction, survey.real, trajectory)
    if case.errors == "independent":
        points = replace(points, covariance=points.own_covariance)
    return judged(reconstruct(points, survey.nodes, prior, config=learned), survey.real, trajectory)


def _floor(survey: Survey) -> Outcome:
    """Map the landmarks as they lie when the path is known: the lower bound for the gaps between the swaths."""
    points = on_the_real_path(survey, LASTING)
    return judged(reconstruct(points, survey.nodes), survey.real, survey.real.trajectory)


if __name__ == "__main__":
    main("Joint mapping in images", measure, ("numpy", "scipy", "opencv-python-headless"))
