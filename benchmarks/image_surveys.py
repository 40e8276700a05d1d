"""What the benchmarks of surveys in images share: receivers read anew, landmarks on the real path, maps judged."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sim.gps import GpsReceiver
from sim.motion import Motion
from sim.sensor_config import GpsConfig, InstrumentsConfig
from survey.arrays import FloatArray
from survey.dem import Dem
from survey.grid import Grid
from survey.reconstruction import Reconstruction
from survey.recording import Recording
from survey.sensors import GpsFixes
from survey.surface_points import SurfacePoints
from survey.trajectory import Trajectory
from survey.truth import Truth
from vision_slam import LocalizationConfig
from vision_slam.visual_slam import VisualOdometry

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
    """Read a receiver anew along the way that was really driven."""
    path = survey.real.trajectory
    still = np.zeros_like(path.position)
    motion = Motion(path.time_s, path.position, path.quaternion, still, still, still[:, :2])
    config = InstrumentsConfig(gps=GpsConfig(profile=profile))
    receiver = GpsReceiver(config, survey.recording.antenna_height_m, seed)
    return receiver.sense(motion, path.position[0])[0]


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
