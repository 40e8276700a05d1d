"""What helps a survey to its absolute height: stakes, a base station, an accelerometer, places recognised again, the way home."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from planners.ground.transit import FreeGround
from sim.config.mission import AidsConfig, MissionConfig
from sim.instruments.gauss_markov import gauss_markov
from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.recording import Recording
from survey.data.route import Leg, Route
from survey.data.sensors import Barometer, GpsFixes, Inertial, LoopClosures, Stakes, StakeSightings
from survey.data.trajectory import Trajectory
from vision_slam.rotation import rotations

_GRAVITY_M_S2 = 9.81
# Standing, turning and standing again take this long each; nothing jolts but the motor's hum.
_STAND_S, _STILL_SHARE = 20.0, 0.1
# A stake stands this far beside the way; it is seen when the rover is nearest.
_BESIDE_M = 1.5
_SEEN_SIGMA_M = 0.03
# Two visits are of one place when they are this near, and this much driving apart.
_MEETS_M, _APART_M, _SPACED_M = 7.5, 80.0, 30.0
_RECOGNISED_SIGMA_M = 0.1


def with_way_home(route: Route, area: SurveyArea) -> Route:
    """Return the route with the shortest way on free ground from its end back to its start.

    Raises
    ------
    InputError
        No way joins them, or the route is that of several rovers.
    """
    if route.n_rovers > 1:
        raise InputError("aids.way_home is for one rover; leave it out, or set fleet.rovers = 1.")
    start, end = route.legs[0].xy[0], route.legs[-1].xy[-1]
    way = FreeGround(area.free).way(end, start)
    return replace(route, legs=(*route.legs, Leg("transit", way)))


def with_aids(
    recording: Recording,
    trajectory: Trajectory,
    attitude_rad: FloatArray,
    route: Route,
    mission: MissionConfig,
) -> Recording:
    """Return the recording with what the mission's aids sense on a drive (poses and roll, pitch, yaw as they are)."""
    aids, seed = mission.aids, mission.seed
    changes: dict[str, object] = {}
    if not aids.barometer:
        changes["barometer"] = None
    if aids.accelerometer:
        changes["inertial"] = _inertial(trajectory, attitude_rad, mission)
    if aids.stakes:
        where = _ends_of_swaths(trajectory, route, aids.stakes)
        rng = stream(seed, "aids", "stakes")
        changes |= _stakes(trajectory, attitude_rad, where, aids, rng)
    if aids.recognition > 0.0:
        found = _closures(trajectory, attitude_rad, aids, stream(seed, "aids", "closures"))
        changes |= {"loop_closures": found} if found is not None else {}
    if aids.base_station:
        recording, changes["base"] = _with_base(recording, trajectory, mission)
    if aids.base_barometer and recording.barometer is not None and aids.barometer:
        changes["base_barometer"] = _base_barometer(recording, trajectory, mission)
    if aids.start == "unknown":
        changes["start"] = recording.gps.position[0] - [0.0, 0.0, recording.antenna_height_m]
        turn = np.radians(aids.heading_sigma_deg) * stream(seed, "aids", "heading").standard_normal()
        assert recording.odometry is not None
        turned = recording.odometry.attitude_rad + [0.0, 0.0, turn]
        changes["odometry"] = replace(recording.odometry, attitude_rad=turned)
    return replace(recording, **changes)  # type: ignore[arg-type]


def _inertial(trajectory: Trajectory, attitude_rad: FloatArray, mission: MissionConfig) -> Inertial:
    """Draw specific force and rates: gravity and the path's own acceleration, a constant bias, jolts."""
    aids, times = mission.aids, trajectory.time_s
    rng = stream(mission.seed, "aids", "accelerometer")
    velocity = np.gradient(trajectory.position, times, axis=0)
    force = np.gradient(velocity, times, axis=0) + [0.0, 0.0, _GRAVITY_M_S2]
    body = np.einsum("nji,nj->ni", rotations(attitude_rad), force)
    bias = aids.accelerometer_bias_m_s2 * rng.standard_normal(3)
    jolts = aids.accelerometer_white_m_s2 * rng.standard_normal(body.shape)
    rates = np.gradient(np.unwrap(attitude_rad, axis=0), times, axis=0)
    if mission.sensors.heading_walk_deg_sqrt_m > 0.0:  # the gyro is to hold the heading: no turn may be lost
        rates = _mean_rates(attitude_rad, times)
    driving = Inertial(times, rates, body + bias + jolts)
    if not aids.turn_at_start:
        return driving
    noise = _STILL_SHARE * aids.accelerometer_white_m_s2
    return _after_turning(driving, attitude_rad[0], bias, noise, rng)


def _mean_rates(attitude_rad: FloatArray, times: FloatArray) -> FloatArray:
    """Return the mean rates of turn (N, 3) over the time before each moment, as a gyro tells them."""
    body = Rotation.from_euler("xyz", attitude_rad)
    turned = (body[:-1].inv() * body[1:]).as_rotvec()
    return np.vstack([np.zeros(3), turned / np.diff(times)[:, None]])


def _after_turning(
    driving: Inertial, start_rad: FloatArray, bias: FloatArray, noise: float, rng: np.random.Generator
) -> Inertial:
    """Put a minute before the drive: stand turned about, turn on the spot, stand as the drive begins."""
    seconds = np.arange(3.0 * _STAND_S)
    turned = np.pi * np.clip((2.0 * _STAND_S - seconds) / _STAND_S, 0.0, 1.0)
    forward, left = -np.tan(start_rad[1]), np.tan(start_rad[0])
    ahead, aside = (
        np.cos(turned) * forward + np.sin(turned) * left,
        np.cos(turned) * left - np.sin(turned) * forward,
    )
    attitude = np.column_stack([np.arctan(aside), -np.arctan(ahead), start_rad[2] + turned])
    force = rotations(attitude)[:, 2, :] * _GRAVITY_M_S2
    force = force + bias + noise * rng.standard_normal(force.shape)
    rates = np.column_stack([np.zeros((len(seconds), 2)), np.gradient(turned)])
    return Inertial(
        np.concatenate([seconds - len(seconds) + driving.time_s[0], driving.time_s]),
        np.concatenate([rates, driving.gyro_rad_s]),
        np.concatenate([force, driving.specific_force_m_s2]),
    )


def _ends_of_swaths(trajectory: Trajectory, route: Route, n_stakes: int) -> IntArray:
    """Poses nearest to the far ends of swaths: of the last swath first, then evenly."""
    ends = np.array([swath.xy[-1] for swath in route.swaths])
    chosen = np.unique(np.round(np.linspace(len(ends) - 1, 0, n_stakes + 1)[:-1]).astype(np.int64))
    chosen = chosen if len(chosen) == n_stakes else np.arange(len(ends))[-n_stakes:]
    gaps = np.hypot(*(trajectory.position[:, None, :2] - ends[chosen][None]).transpose(2, 0, 1))
    nearest: IntArray = np.argmin(gaps, axis=0)
    return np.sort(nearest)


def _stakes(
    trajectory: Trajectory,
    attitude_rad: FloatArray,
    where: IntArray,
    aids: AidsConfig,
    rng: np.random.Generator,
) -> dict[str, object]:
    """Stand stakes beside the way, survey them, and see each once in passing."""
    left = rotations(attitude_rad[where])[:, :, 1] * _BESIDE_M
    real = trajectory.position[where] + left
    surveyed = real + aids.stake_sigma_m * rng.standard_normal(real.shape)
    offset = np.einsum("nji,nj->ni", rotations(attitude_rad[where]), left)
    offset = offset + _SEEN_SIGMA_M * rng.standard_normal(offset.shape)
    spread = np.tile(_SEEN_SIGMA_M**2 * np.eye(3), (len(where), 1, 1))
    seen = StakeSightings(trajectory.time_s[where], np.arange(len(where), dtype=np.float64), offset, spread)
    return {"stakes": Stakes(surveyed, np.full(len(where), aids.stake_sigma_m)), "stake_sightings": seen}


def _closures(
    trajectory: Trajectory, attitude_rad: FloatArray, aids: AidsConfig, rng: np.random.Generator
) -> LoopClosures | None:
    """Recognise some of the places where the way meets itself; a share of the recognitions is wrong."""
    pairs = _meetings(trajectory)
    pairs = pairs[rng.random(len(pairs)) < aids.recognition]
    if not len(pairs):
        return None
    earlier, later = pairs.T
    moved = trajectory.position[later] - trajectory.position[earlier]
    offset = np.einsum("nji,nj->ni", rotations(attitude_rad[earlier]), moved)
    offset = offset + _RECOGNISED_SIGMA_M * rng.standard_normal(offset.shape)
    wrong = np.arange(len(pairs)) < aids.wrong_closures
    offset = offset + wrong[:, None] * np.array([6.0, 0.0, 0.6])
    spread = np.tile(_RECOGNISED_SIGMA_M**2 * np.eye(3), (len(pairs), 1, 1))
    return LoopClosures(trajectory.time_s[later], trajectory.time_s[earlier], offset, spread)


def _meetings(trajectory: Trajectory) -> IntArray:
    """Pairs of poses (M, 2) of one place, visited twice; the nearest of each meeting, in the order of the later."""
    steps = np.linalg.norm(np.diff(trajectory.position, axis=0), axis=1)
    travel = np.r_[0.0, np.cumsum(steps)]
    xy = trajectory.position[:, :2]
    distance = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    near = (distance < _MEETS_M) & (travel[None] - travel[:, None] > _APART_M)
    i, j = np.nonzero(near)
    kept: list[tuple[int, int]] = []
    for k in np.argsort(distance[i, j], kind="stable"):
        a, b = int(i[k]), int(j[k])
        if all(abs(travel[b] - travel[d]) > _SPACED_M for _, d in kept):
            kept.append((a, b))
    return np.array(sorted(kept, key=lambda pair: pair[1]), dtype=np.int64).reshape(-1, 2)


def _with_base(
    recording: Recording, trajectory: Trajectory, mission: MissionConfig
) -> tuple[Recording, GpsFixes]:
    """Share most of the receiver's slow error with a second receiver at the start.

    The rover's error is split into the part that both have and a part of its own, so that
    what is left after differencing has the stated share.
    """
    sensors, times = mission.sensors, trajectory.time_s
    rng = stream(mission.seed, "aids", "base")
    per_axis = np.array([1.0, 1.0, sensors.gps_vertical_factor])
    own_share = mission.aids.base_residual
    gaps = np.diff(times)
    common, own = (
        gauss_markov(gaps, sensors.gps_correlation_time_s, sensors.gps_bias_sigma_m * share, rng, 3)
        for share in (np.sqrt(1.0 - own_share**2), own_share)
    )
    white = sensors.gps_white_sigma_m * rng.standard_normal((2, *common.shape))
    antenna = trajectory.position + [0.0, 0.0, mission.rover.antenna_height_m]
    rover = GpsFixes(times, antenna + (common + own + white[0]) * per_axis)
    base = GpsFixes(times, trajectory.position[0] + (common + white[1]) * per_axis)
    return replace(recording, gps=rover), base


def _base_barometer(recording: Recording, trajectory: Trajectory, mission: MissionConfig) -> Barometer:
    """Let a second barometer at the start feel the weather of the first but for a share of its own."""
    sensors, times = mission.sensors, trajectory.time_s
    rng = stream(mission.seed, "aids", "base barometer")
    assert recording.barometer is not None
    weather = recording.barometer.height_m - trajectory.position[:, 2]
    sigma = sensors.barometer_drift_sigma_m * mission.aids.base_barometer_residual
    own = gauss_markov(np.diff(times), sensors.barometer_correlation_time_s, sigma, rng)[:, 0]
    return Barometer(times, trajectory.position[0, 2] + weather + own)
