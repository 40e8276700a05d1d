"""Shared functions of the benchmarks of surveys in images: drives, receivers, scores of maps, tables."""

import pickle
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.report import Row
from benchmarks.stored_parts import code_digest, simulated_folder
from sim.config.sensors import GpsConfig, InstrumentsConfig
from sim.instruments.gps import GpsReceiver
from sim.vehicle.motion import RoverMotion
from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.recording import Recording
from survey.data.sensors.records import GpsFixes
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.data.truth import Truth
from survey.reconstruction import Reconstruction
from vision_slam import LocalizationConfig
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.visual_odometry import visual_odometry

EXAMPLES = Path(__file__).parents[1] / "examples"
SURVEYS = simulated_folder("surveys")
_ODOMETRY_CODE = (
    "vision_slam/odometry",
    "vision_slam/attitude.py",
    "vision_slam/motion.py",
    "vision_slam/config.py",
)
Profile = Literal["white", "gauss-markov-60", "gauss-markov-300"]


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


def fixes_along(survey: Survey, profile: Profile, seed: int) -> GpsFixes | None:
    """Simulate the fixes of a receiver along the true path."""
    path = survey.real.trajectory
    still = np.zeros_like(path.position)
    motion = RoverMotion(path.time_s, path.position, path.quaternion, still, still, still[:, :2])
    config = InstrumentsConfig(gps=GpsConfig(profile=profile))
    receiver = GpsReceiver(config, survey.recording.antenna_height_m, seed)
    return receiver.sense(motion)


def on_the_real_path(survey: Survey, gates: LocalizationConfig) -> SurfacePoints:
    """Place the landmarks that pass the gates as they lie when the path is known: what is left is their own error."""
    path, seen = survey.real.trajectory, survey.found.sightings
    times = survey.found.odometry.time_s[seen.pose].clip(max=path.time_s[-1])
    place = np.column_stack([np.interp(times, path.time_s, axis) for axis in path.position.T])
    turn = Slerp(path.time_s, Rotation.from_quat(path.quaternion))(times).as_matrix()
    covariance = turn @ seen.covariance @ turn.transpose(0, 2, 1)
    kept = (seen.range_m > gates.landmark_min_range_m) & (
        np.linalg.eigvalsh(covariance)[:, -1] <= gates.landmark_max_sigma_m**2
    )
    xyz = place + np.einsum("nij,nj->ni", turn, seen.offset)
    return SurfacePoints(xyz[kept], covariance=covariance[kept], crs=survey.prior.crs)


def judged(result: Reconstruction, real: Truth, path: Trajectory) -> Outcome:
    """Compare a map with the whole terrain, snow relief and all."""
    error = result.mean.elevation - real.dem.at(result.mean.xy).reshape(result.mean.shape)
    within = np.abs(error) <= 1.959964 * result.std.elevation
    height = np.interp(path.time_s, real.trajectory.time_s, real.trajectory.position[:, 2])
    vertical: FloatArray = path.position[:, 2] - height
    rmse, path_m = (float(np.sqrt(np.mean(values**2))) for values in (error, vertical))
    return Outcome(rmse, float(error.mean()), float(within.mean()), path_m)


def rows_of(name: str, done: Sequence[Outcome]) -> Iterator[Row]:
    """Return rows for several surveys: errors, coverage, path."""
    rmse, coverage = np.array([out.rmse_m for out in done]), np.array([out.coverage for out in done])
    yield Row(f"{name}: RMSE, median", float(np.median(rmse)), "m")
    yield Row(f"{name}: RMSE, worst", float(rmse.max()), "m")
    offset = float(np.sqrt(np.mean([out.offset_m**2 for out in done])))
    yield Row(f"{name}: site-mean error, RMS", offset, "m")
    yield Row(f"{name}: coverage of 95 %, mean", float(coverage.mean()), "1")
    yield Row(f"{name}: coverage of 95 %, worst survey", float(coverage.min()), "1")
    path = float(np.median([out.path_m for out in done]))
    yield Row(f"{name}: vertical error of the path before the map, median", path, "m")


def survey_in_images(seed: int) -> Survey:
    """Return the development survey of a seed; it is driven, and its images followed, where that was not done before."""
    run = _simulated(EXAMPLES / "mendenhall_like.toml", SURVEYS / str(seed), (f"seed={seed}",))
    recording = Recording.read(run / "2-simulate" / "recording")
    return survey_at(run, recording, seen(run, recording))


def survey_at(run: Path, recording: Recording, found: VisualOdometry) -> Survey:
    """Return the survey of a run's folder, to be judged on 80 nodes a side."""
    real, prior = Truth.read(run / "2-simulate" / "truth"), Dem.read(run / "1-plan" / "prior.tif")
    bounds = SurveyArea.read(run / "1-plan" / "area.gpkg").bounds
    nodes = Grid.over(bounds, (bounds[2] - bounds[0]) / 80.0, prior.crs)
    return Survey(replace(recording, frames=None, camera=None), found, real, prior, nodes)


def _simulated(mission: Path, runs: Path, settings: tuple[str, ...]) -> Path:
    """Return the run's folder; render where that was not done before."""
    found = sorted(runs.glob("*/latest/2-simulate/drive.json"))
    if not found:
        chosen = [word for text in settings for word in ("--set", text)]
        command = [sys.executable, "-m", "firnline.cli.main", "simulate", str(mission), "--runs", str(runs)]
        subprocess.run([*command, *chosen], check=True, capture_output=True, stdin=subprocess.DEVNULL)
        found = sorted(runs.glob("*/latest/2-simulate/drive.json"))
    return found[0].parents[1]


def seen(run: Path, recording: Recording) -> VisualOdometry:
    """Return what the images say, stored for as long as the code that reads them stays the same."""
    kept = _kept(run)
    if not kept.exists():
        keep(run, visual_odometry(recording))
    found: VisualOdometry = pickle.loads(kept.read_bytes())
    return found


def keep(run: Path, found: VisualOdometry) -> None:
    """Keep what the images of a run say."""
    _kept(run).write_bytes(pickle.dumps(found))


def _kept(run: Path) -> Path:
    return run.parent / f"seen-{code_digest(_ODOMETRY_CODE)}.pickle"
