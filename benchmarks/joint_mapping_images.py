"""What one estimate of map and path is worth where landmarks come from images: surveys of 2.7 km, seen by a camera.

Run with ``python -m benchmarks.joint_mapping_images``. The drives are those of ``examples/mendenhall_like.toml`` with
seeds that no setting was chosen on; images are rendered once (12 minutes of CPU each) and kept in the system's folder
for temporary files. On every drive a receiver of either memory is read anew. The cases are those of
``benchmarks.joint_mapping``; no error is debiased, and no place is recognised. Beside them stands what the landmarks
give on the path that was really driven: no estimate of the path can map the gaps between the swaths better.
"""

import hashlib
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
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.report import Row, main
from sim.gps import GpsReceiver
from sim.motion import Motion
from sim.sensor_config import GpsConfig, InstrumentsConfig
from survey.area import SurveyArea
from survey.arrays import FloatArray
from survey.dem import Dem
from survey.grid import Grid
from survey.reconstruction import GaussianProcessConfig, Reconstruction, reconstruct
from survey.reconstruction.config import JointConfig, SatelliteErrors
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.recording import Recording
from survey.sensors import GpsFixes
from survey.surface_points import SurfacePoints
from survey.trajectory import Trajectory
from survey.truth import Truth
from vision_slam import LocalizationConfig, visual_slam
from vision_slam.pipeline import localize_seen
from vision_slam.visual_slam import VisualOdometry, visual_odometry

EXAMPLES = Path(__file__).parents[1] / "examples"
SURVEYS = Path(tempfile.gettempdir()) / "firnline-surveys"
SEEDS = (61, 62, 63)
STATED = JointConfig(satellite=SatelliteErrors(sigma_m=1.0), bow_sigma_deg=0.3)
"""Landmarks of the development surveys rose by 0.35 degrees ahead, and sank by 0.15 aside."""
PROFILES: dict[str, Literal["gauss-markov-60", "gauss-markov-300"]] = {
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


@dataclass(frozen=True)
class Survey:
    """A drive whose images were turned into odometry and sightings, with the world it took place in."""

    recording: Recording
    found: VisualOdometry
    real: Truth
    prior: Dem
    nodes: Grid


@dataclass(frozen=True)
class Outcome:
    """How a map came out: errors [m], never debiased, and its coverage; and the path's vertical error [m]."""

    rmse_m: float
    offset_m: float
    coverage: float
    path_m: float


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
    found = _seen(run, recording)
    real, prior = Truth.read(run / "2-simulate" / "truth"), Dem.read(run / "1-plan" / "prior.tif")
    xmin, ymin, xmax, ymax = SurveyArea.read(run / "1-plan" / "area.gpkg").bounds
    step = (xmax - xmin) / 80.0
    nodes = Grid(
        (xmin + 0.5 * step, ymin + 0.5 * step, xmax - 0.5 * step, ymax - 0.5 * step), step, prior.crs
    )
    return Survey(replace(recording, frames=None, camera=None), found, real, prior, nodes)


def _seen(run: Path, recording: Recording) -> VisualOdometry:
    """Return what the images say, kept for as long as the code that reads them stays the same."""
    code = b"".join(path.read_bytes() for path in _read_by(Path(visual_slam.__file__)))
    kept = run.parent / f"seen-{hashlib.sha256(code).hexdigest()[:12]}.pickle"
    if not kept.exists():
        kept.write_bytes(pickle.dumps(visual_odometry(recording)))
    found: VisualOdometry = pickle.loads(kept.read_bytes())
    return found


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


def _mapped(
    survey: Survey, case: Case, profile: Literal["gauss-markov-60", "gauss-markov-300"], draw: int
) -> Outcome:
    """Localize and map a survey with a receiver of its own luck."""
    kept: dict[str, Any] = {"gps": _fixes(survey, profile, draw), "base": None}
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
        return _judged(found.reconstruction, survey.real, trajectory)
    if case.errors == "independent":
        points = replace(points, covariance=points.own_covariance)
    return _judged(reconstruct(points, survey.nodes, prior, config=learned), survey.real, trajectory)


def _floor(survey: Survey) -> Outcome:
    """Map the landmarks as they lie when the path is known: what is left is theirs, and the gaps' between swaths."""
    path, seen, gates = survey.real.trajectory, survey.found.sightings, ASSUMED
    times = survey.found.odometry.time_s[seen.pose]
    place = np.column_stack([np.interp(times, path.time_s, axis) for axis in path.position.T])
    turn = Slerp(path.time_s, Rotation.from_quat(path.quaternion))(
        times.clip(max=path.time_s[-1])
    ).as_matrix()
    covariance = turn @ seen.covariance @ turn.transpose(0, 2, 1)
    kept = (seen.range_m > gates.landmark_min_range_m) & (
        np.linalg.eigvalsh(covariance)[:, -1] <= gates.landmark_max_sigma_m**2
    )
    xyz = place + np.einsum("nij,nj->ni", turn, seen.offset)
    points = SurfacePoints(xyz[kept], covariance=covariance[kept], crs=survey.prior.crs)
    return _judged(reconstruct(points, survey.nodes), survey.real, path)


def _fixes(
    survey: Survey, profile: Literal["gauss-markov-60", "gauss-markov-300"], draw: int
) -> GpsFixes | None:
    """Read a receiver anew along the way that was really driven."""
    path = survey.real.trajectory
    still = np.zeros_like(path.position)
    motion = Motion(path.time_s, path.position, path.quaternion, still, still, still[:, :2])
    config = InstrumentsConfig(gps=GpsConfig(profile=profile))
    receiver = GpsReceiver(config, survey.recording.antenna_height_m, 1000 + draw)
    return receiver.sense(motion, path.position[0])[0]


def _judged(result: Reconstruction, real: Truth, path: Trajectory) -> Outcome:
    """Compare a map with the whole terrain, snow relief and all."""
    error = result.mean.elevation - real.dem.at(result.mean.xy).reshape(result.mean.shape)
    within = np.abs(error) <= 1.959964 * result.std.elevation
    height = np.interp(path.time_s, real.trajectory.time_s, real.trajectory.position[:, 2])
    vertical: FloatArray = path.position[:, 2] - height
    rmse, path_m = (float(np.sqrt(np.mean(values**2))) for values in (error, vertical))
    return Outcome(rmse, float(error.mean()), float(within.mean()), path_m)


if __name__ == "__main__":
    main("Joint mapping in images", measure, ("numpy", "scipy", "opencv-python-headless", "gtsam"))
