"""Stakes of surveyed position: their survey, and their sightings from the rover."""

import numpy as np

from sim.config.sensors import StakeConfig
from sim.instruments.sensor import StatisticalDrive
from sim.vehicle.motion import RoverMotion
from sim.world.moving_ice import MovingIce
from survey.core.arrays import FloatArray, IntArray
from survey.core.streams import stream
from survey.data.route import Route
from survey.data.sensors.stakes import Stakes, StakeSightings, StakeSurveys
from survey.data.trajectory import Trajectory
from vision_slam.rotation import rotations

# A stake stands this far beside the way; it is seen when the rover is nearest.
_BESIDE_M = 1.5
_SEEN_SIGMA_M = 0.03


def surveyed_stakes(config: StakeConfig, foot: FloatArray, seed: int) -> Stakes | None:
    """Return the stakes as surveyed, from their real places (K, 3) [m]; None without stakes."""
    rng = stream(seed, "instruments", "stakes", "survey")
    surveyed = foot + config.survey_sigma_m * rng.standard_normal(foot.shape)
    return Stakes(surveyed, np.full(len(foot), config.survey_sigma_m)) if len(foot) else None


class StakeSpotter:
    """Detector of stakes, once a second within range.

    Parameters
    ----------
    config : StakeConfig
        Number and errors.
    foot : (K, 3) ndarray
        Real places of the stakes [m].
    seed : int
        The mission's seed.
    """

    def __init__(self, config: StakeConfig, foot: FloatArray, seed: int) -> None:
        self._config, self._foot = config, foot
        self._rng = stream(seed, "instruments", "stakes", "seen")
        self._n_seconds = 0

    def sense(self, motion: RoverMotion) -> StakeSightings | None:
        """Return the sightings during a stretch."""
        last = int(np.floor(motion.time_s[-1] + 1e-6))
        at_s = np.arange(self._n_seconds, last + 1, dtype=np.float64)
        self._n_seconds = max(self._n_seconds, last + 1)
        gap = self._foot[None] - motion.position_at(at_s)[:, None]
        moment, stake = np.nonzero(np.linalg.norm(gap, axis=2) < self._config.range_m)
        if not len(moment):
            return None
        offset = motion.rotation_at(at_s[moment]).inv().apply(gap[moment, stake])
        covariance = self._covariance(offset)
        error = np.einsum(
            "nij,nj->ni", np.linalg.cholesky(covariance), self._rng.standard_normal(offset.shape)
        )
        return StakeSightings(at_s[moment], stake.astype(np.float64), offset + error, covariance)

    def _covariance(self, offset: FloatArray) -> FloatArray:
        """Return covariances (N, 3, 3) along and across the line of sight [m²]; never below a centimetre."""
        distance = np.linalg.norm(offset, axis=1)
        ray = offset / distance[:, None]
        along = np.hypot(self._config.range_error_share * distance, 0.01)
        across = np.hypot(np.radians(self._config.bearing_error_deg) * distance, 0.01)
        outer = ray[:, :, None] * ray[:, None, :]
        covariance: FloatArray = along[:, None, None] ** 2 * outer + across[:, None, None] ** 2 * (
            np.eye(3) - outer
        )
        return covariance


def draw_stakes(drive: StatisticalDrive) -> Stakes | None:
    """Draw the surveyed places of stakes at the ends of swaths; None where the mission has none."""
    return _drawn(drive)[0] if drive.mission.aids.stakes else None


def draw_stake_sightings(drive: StatisticalDrive) -> StakeSightings | None:
    """Draw one sighting of each stake; None where the mission has none."""
    return _drawn(drive)[1] if drive.mission.aids.stakes else None


def draw_stake_surveys(drive: StatisticalDrive) -> StakeSurveys | None:
    """Draw repeated surveys of the stakes on moving ice; None where the mission has none."""
    ice, aids = drive.ice, drive.mission.aids
    if ice is None or not (aids.stakes and ice.config.stake_surveys):
        return None
    return surveyed_repeatedly(
        _feet(drive)[0], ice, drive.trajectory.time_s[[0, -1]], aids.stake_sigma_m, drive.mission.seed
    )


def surveyed_repeatedly(
    foot: FloatArray, ice: MovingIce, ends_s: FloatArray, sigma_m: float, seed: int
) -> StakeSurveys:
    """Return surveys of stakes that stand at places (K, 3) at the start, evenly between two times."""
    n = ice.config.stake_surveys
    time_s = np.repeat(np.linspace(ends_s[0], ends_s[1], n), len(foot))
    stake = np.tile(np.arange(len(foot)), n)
    real = foot[stake] + ice.displacement(foot[stake, :2], time_s)
    error = sigma_m * stream(seed, "ice", "stake surveys").standard_normal(real.shape)
    return StakeSurveys(time_s, stake.astype(np.float64), real + error, np.full(len(real), sigma_m))


def _feet(drive: StatisticalDrive) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the real places (K, 3) of the stakes, the poses that see them, and their offsets (K, 3) from these."""
    trajectory = drive.trajectory
    pose = _ends_of_swaths(trajectory, drive.route, drive.mission.aids.stakes)
    left = rotations(drive.attitude_rad[pose])[:, :, 1] * _BESIDE_M
    return trajectory.position[pose] + left, pose, left


def _drawn(drive: StatisticalDrive) -> tuple[Stakes, StakeSightings]:
    """Place stakes beside the route, survey them, and sight each once."""
    trajectory, sigma_m = drive.trajectory, drive.mission.aids.stake_sigma_m
    real, pose, left = _feet(drive)
    rng, body = stream(drive.mission.seed, "aids", "stakes"), rotations(drive.attitude_rad[pose])
    surveyed = real + sigma_m * rng.standard_normal(real.shape)
    offset = np.einsum("nji,nj->ni", body, left)
    offset = offset + _SEEN_SIGMA_M * rng.standard_normal(offset.shape)
    covariance = np.tile(_SEEN_SIGMA_M**2 * np.eye(3), (len(pose), 1, 1))
    index = np.arange(len(pose), dtype=np.float64)
    sightings = StakeSightings(trajectory.time_s[pose], index, offset, covariance)
    return Stakes(surveyed, np.full(len(pose), sigma_m)), sightings


def _ends_of_swaths(trajectory: Trajectory, route: Route, n_stakes: int) -> IntArray:
    """Return the poses nearest to the far ends of swaths: of the last swath first, then evenly."""
    ends = np.array([swath.xy[-1] for swath in route.swaths])
    chosen = np.unique(np.round(np.linspace(len(ends) - 1, 0, n_stakes + 1)[:-1]).astype(np.int64))
    chosen = chosen if len(chosen) == n_stakes else np.arange(len(ends))[-n_stakes:]
    gaps = np.hypot(*(trajectory.position[:, None, :2] - ends[chosen][None]).transpose(2, 0, 1))
    nearest: IntArray = np.argmin(gaps, axis=0)
    return np.sort(nearest)
