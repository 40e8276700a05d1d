"""What one estimate of map and path is worth where landmarks come from images: surveys of 2.7 km, seen by a camera.

Run with ``python -m benchmarks.joint_mapping_images``. The drives are those of ``examples/mendenhall_like.toml`` with
seeds that no setting was chosen on (``FIRNLINE_SURVEY_SEEDS=61,62`` takes fewer); images are rendered once (12 minutes
of CPU each) and kept in the system's folder for temporary files. On every drive a receiver of either memory is read anew. The cases are those of
``benchmarks.joint_mapping``; no error is debiased, and no place is recognised. Beside them stands what the landmarks
give on the path that was really driven: no estimate of the path can map the gaps between the swaths better.
"""

import hashlib
import os
import pickle
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.image_surveys import Outcome, Profile, Survey, fixes_along, judged, on_the_real_path
from benchmarks.report import Row, main
from survey.area import SurveyArea
from survey.dem import Dem
from survey.grid import Grid
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.config import JointConfig, SatelliteErrors
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.recording import Recording
from survey.truth import Truth
from vision_slam import LocalizationConfig, visual_slam
from vision_slam.pipeline import localize_seen
from vision_slam.visual_slam import VisualOdometry, visual_odometry

EXAMPLES = Path(__file__).parents[1] / "examples"
SURVEYS = Path(tempfile.gettempdir()) / "firnline-surveys"
SEEDS = tuple(int(seed) for seed in os.environ.get("FIRNLINE_SURVEY_SEEDS", "61,62,63").split(","))
STATED = JointConfig(satellite=SatelliteErrors(sigma_m=1.0), bow_sigma_deg=0.3)
"""Landmarks of the development surveys rose by 0.35 degrees ahead, and sank by 0.15 aside."""
PROFILES: dict[str, Profile] = {
    "tau 60 s": "gauss-markov-60",
    "tau 300 s": "gauss-markov-300",
}
ASSUMED = LocalizationConfig(gps_bias_sigma_m=3.0, gps_white_sigma_m=1.0, gps_correlation_time_s=300.0)
_SHORT = ("area.bounds_m=[526060.0,6478060.0,526100.0,6478090.0]", "planner.swaths=2")


@dataclass(frozen=True)
class Case:
    """What is used of a recording, and how it is mapped."""

    name: str
    errors: Literal["independent", "inflated", "joint"] = "joint"
    satellite: bool = True
    level: bool = False
    stakes: bool = False


CASES = (
    Case("per-landmark noise", "independent", satellite=False),
    Case("inflated noise", "inflated", satellite=False),
    Case("joint", satellite=False),
    Case("joint + satellite"),
    Case("+ gravity, barometer", level=True),
    Case("+ 4 stakes", level=True, stakes=True),
)


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    surveys = [_short_survey()] if quick else [survey_in_images(seed) for seed in SEEDS]
    for survey in surveys:
        yield Row("landmarks", float(len(survey.found.sightings.pose)), "1")
        floor = _floor(survey)
        yield Row("landmarks placed by the real path: RMSE of the map", floor.rmse_m, "m")
        yield Row("landmarks placed by the real path: coverage of 95 %", floor.coverage, "1")
    for name, profile in list(PROFILES.items())[: 1 if quick else None]:
        medians = {}
        for case in CASES:
            done = [_mapped(survey, case, profile, draw) for draw, survey in enumerate(surveys)]
            medians[case.name] = float(np.median([out.rmse_m for out in done]))
            yield from _rows(f"{case.name}, {name}", done)
        gain = medians[CASES[0].name] / medians[CASES[3].name]
        yield Row(f"{name}: per-landmark noise / joint + satellite", gain, "x")


def _rows(name: str, done: list[Outcome]) -> Iterator[Row]:
    rmse = np.array([out.rmse_m for out in done])
    yield Row(f"{name}: RMSE, median", float(np.median(rmse)), "m")
    yield Row(f"{name}: RMSE, worst", float(rmse.max()), "m")
    offset = float(np.sqrt(np.mean([out.offset_m**2 for out in done])))
    yield Row(f"{name}: site-mean error, RMS", offset, "m")
    coverage = np.array([out.coverage for out in done])
    yield Row(f"{name}: coverage of 95 %", float(coverage.mean()), "1")
    yield Row(f"{name}: coverage of the worst survey", float(coverage.min()), "1")
    path = float(np.median([out.path_m for out in done]))
    yield Row(f"{name}: vertical error of the path before the map, median", path, "m")


def survey_in_images(seed: int) -> Survey:
    """Return the survey of a seed; its images are rendered and followed where that was not done before."""
    return _read(_simulated(EXAMPLES / "mendenhall_like.toml", SURVEYS / str(seed), (f"seed={seed}",)))


def _short_survey() -> Survey:
    return _read(
        _simulated(EXAMPLES / "glacier_drive.toml", SURVEYS / "short", (f"seed={SEEDS[0]}", *_SHORT))
    )


def _simulated(mission: Path, runs: Path, settings: tuple[str, ...]) -> Path:
    """Return the run's folder; render where that was not done before."""
    found = sorted(runs.glob("*/latest/2-simulate/drive.json"))
    if not found:
        chosen = [word for text in settings for word in ("--set", text)]
        command = [sys.executable, "-m", "sim.cli.main", "simulate", str(mission), "--runs", str(runs)]
        subprocess.run([*command, *chosen], check=True, capture_output=True, stdin=subprocess.DEVNULL)
        found = sorted(runs.glob("*/latest/2-simulate/drive.json"))
    return found[0].parents[1]


def _read(run: Path) -> Survey:
    recording = Recording.read(run / "2-simulate" / "recording")
    found = seen(run, recording)
    real, prior = Truth.read(run / "2-simulate" / "truth"), Dem.read(run / "1-plan" / "prior.tif")
    xmin, ymin, xmax, ymax = SurveyArea.read(run / "1-plan" / "area.gpkg").bounds
    step = (xmax - xmin) / 80.0
    nodes = Grid(
        (xmin + 0.5 * step, ymin + 0.5 * step, xmax - 0.5 * step, ymax - 0.5 * step), step, prior.crs
    )
    return Survey(replace(recording, frames=None, camera=None), found, real, prior, nodes)


def seen(run: Path, recording: Recording) -> VisualOdometry:
    """Return what the images say, kept for as long as the code that reads them stays the same."""
    kept = _kept(run)
    if not kept.exists():
        keep(run, visual_odometry(recording))
    found: VisualOdometry = pickle.loads(kept.read_bytes())
    return found


def keep(run: Path, found: VisualOdometry) -> None:
    """Keep what the images of a run say."""
    _kept(run).write_bytes(pickle.dumps(found))


def _kept(run: Path) -> Path:
    code = b"".join(path.read_bytes() for path in _read_by(Path(visual_slam.__file__)))
    return run.parent / f"seen-{hashlib.sha256(code).hexdigest()[:12]}.pickle"


def _read_by(module: Path) -> list[Path]:
    """Return a module's file and those of its package that it imports, directly or through others, in order."""
    found, waiting = set(), [module]
    while waiting:
        found.add(path := waiting.pop())
        names = re.findall(
            rf"^\s*from {path.parent.name}\.(\w+) import", path.read_text("utf-8"), re.MULTILINE
        )
        waiting += {path.with_name(f"{name}.py") for name in names} - found
    return sorted(found)


def _mapped(survey: Survey, case: Case, profile: Profile, draw: int) -> Outcome:
    """Localize and map a survey with a receiver of its own luck."""
    kept: dict[str, Any] = {"gps": fixes_along(survey, profile, 1000 + draw), "base": None}
    if not case.level:
        kept |= {"inertial": None, "barometer": None, "base_barometer": None}
    if not case.stakes:
        kept |= {"stakes": None, "stake_sightings": None}
    trajectory, points, _ = localize_seen(replace(survey.recording, **kept), survey.found, ASSUMED)
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
    """Map the landmarks as they lie when the path is known: no more can be told of the gaps between the swaths."""
    points = on_the_real_path(survey, ASSUMED)
    return judged(reconstruct(points, survey.nodes), survey.real, survey.real.trajectory)


if __name__ == "__main__":
    main("Joint mapping in images", measure, ("numpy", "scipy", "opencv-python-headless", "gtsam"))
