"""Causal filtering of a recording: the particle filter over all records in the order of time."""

from dataclasses import dataclass, replace

import numpy as np

from survey import Trajectory
from survey.core import BoolArray, FloatArray, stream
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry
from vision_slam.attitude import quaternions, rotations
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.error_terms import (
    compass_offset,
    differenced_fixes,
    differenced_heights,
    signed_travel,
    stated_errors,
)
from vision_slam.fusion.particle_filter import GyroTurn, ParticleFilter
from vision_slam.motion import GyroErrors, dead_reckoning, gyro_residual_rad
from vision_slam.odometry.odometer import VisualOdometry

_SET_OFF_M = 5.0
_HALF_S = 0.25  # to either side, over which the velocity is taken


@dataclass(frozen=True)
class OnlinePath:
    """Causal poses: each uses only records up to its own time.

    ``time_s`` (N,), ``position`` (N, 3) [m], ``covariance`` (N, 3, 3) [m²], ``turn_rad`` (N,)
    of the odometry's frame in the world, ``is_lost`` (N,); ``accepted`` (M,) whether each fix of
    the recording passed the innovation gate, ``n_fixes`` how many lie within the time of the path.
    """

    time_s: FloatArray
    position: FloatArray
    covariance: FloatArray
    turn_rad: FloatArray
    is_lost: BoolArray
    accepted: BoolArray
    n_fixes: int

    @property
    def n_refused(self) -> int:
        """Number of fixes within the time of the path that failed the gate."""
        return self.n_fixes - int(self.accepted.sum())

    def trajectory(self, recording: OdometryRecording) -> Trajectory:
        """Return the poses as a trajectory, with health 0 where the filter is lost."""
        attitude = recording.odometry.attitude_rad + self.turn_rad[:, None] * [0.0, 0.0, 1.0]
        return Trajectory(
            self.time_s,
            self.position,
            quaternions(attitude),
            self.covariance,
            recording.crs,
            health=1.0 - self.is_lost,
        )


def filter_path(
    recording: OdometryRecording, dead_reckoned: FloatArray, config: LocalizationConfig
) -> OnlinePath:
    """Filter a dead-reckoned path (N, 3) [m] with fixes, barometer, gyro and wheels in the order of time.

    Where the heading at the start is not known to 1°, the odometry is rotated back to the
    compass; without a compass all headings are tried. Roll and pitch are not causal for
    images: they are levelled by gravity over half a minute to either side. The clock of the fixes
    is not estimated: its error is one of each fix along the path, and of each pose.
    """
    poses_s = recording.odometry.time_s
    fixes, settings = differenced_fixes(recording, config)
    measured, settings = differenced_heights(recording, settings)
    heights = np.zeros(0) if measured is None else measured
    back, settings = compass_offset(recording, settings)
    cosine, sine = np.cos(back), np.sin(back)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    path = (dead_reckoned - recording.start) @ turn.T + recording.start
    up = rotations(recording.odometry.attitude_rad)[:, :, 2] @ turn.T
    antenna = fixes - _at(recording.gps.time_s, poses_s, up) * recording.antenna_height_m
    ratio = stated_errors(recording.gps, config)
    filtered = ParticleFilter(settings, stream(0, "particles"), start=recording.start)
    events = _events(recording, measured is not None)
    walk = _Walk(recording, path, np.array([now_s for now_s, _, _ in events]), settings)
    accepted = np.zeros(len(antenna), dtype=np.bool_)
    clock = None if settings.clock_sigma_s == 0.0 else _Clock(poses_s, path, settings.clock_sigma_s)
    estimates = []
    for k, (_, kind, index) in enumerate(events):
        walk.on(k, filtered)
        if kind == _POSE:
            estimates.append(filtered.estimate())
        elif kind == _FIX:
            along_m = None if clock is None else clock.at(float(recording.gps.time_s[index]))
            accepted[index] = filtered.correct(antenna[index], float(ratio[index]), along_m)
        else:
            filtered.correct_height(float(heights[index]))
    covariance = np.array([now.covariance for now in estimates])
    turned_rad = np.array([now.heading_rad for now in estimates])
    if clock is not None:
        covariance = covariance + clock.covariance(turned_rad)
    return OnlinePath(
        poses_s,
        np.array([now.position for now in estimates]),
        covariance,
        turned_rad + back,
        np.array([now.is_lost for now in estimates]),
        accepted,
        sum(kind == _FIX for _, kind, _ in events),
    )


def gate_fixes(recording: OdometryRecording, online: OnlinePath) -> OdometryRecording:
    """Return the recording without the fixes that failed the gate, unless fewer than two are left."""
    return select_fixes(recording, online.accepted)


def select_fixes(recording: OdometryRecording, used: BoolArray) -> OdometryRecording:
    """Return the recording with the used fixes (M,) only, unless these are fewer than two."""
    fixes = recording.gps
    if used.all() or used.sum() < fixes.LEAST:
        return recording
    return replace(recording, gps=fixes.select(used))


def predicted_covariance(odometry: Odometry, config: LocalizationConfig) -> FloatArray:
    """Return the covariances of dead-reckoned positions (N, 3, 3) [m²] from a known start and heading.

    The filter predicts and nothing corrects it, so that they grow with the travel. An unknown
    unit of length is no error; it is that of the path.
    """
    known = config.model_copy(update={"start": "surveyed", "heading_sigma_deg": 0.0})
    filtered = ParticleFilter(known, stream(0, "particles"), start=np.zeros(3))
    steps = np.einsum("nij,nj->ni", rotations(odometry.attitude_rad[:-1]), odometry.step)
    turned = np.abs(np.diff(np.unwrap(odometry.attitude_rad[:, 2])))
    none = np.zeros(len(steps))
    step_sigma = none if odometry.step_sigma_m is None else odometry.step_sigma_m
    turn_sigma = none if odometry.turn_sigma_rad is None else odometry.turn_sigma_rad
    unseen = np.hypot(step_sigma, config.turn_sigma_m * np.sqrt(turned))
    covariance = [filtered.estimate().covariance]
    for step, seconds, metres, turn in zip(
        steps, np.diff(odometry.time_s).tolist(), unseen.tolist(), turn_sigma.tolist(), strict=True
    ):
        filtered.move(step, seconds, metres, turn)
        covariance.append(filtered.estimate().covariance)
    return np.array(covariance)


def adjusted_covariance(
    visual: VisualOdometry, config: LocalizationConfig, wheel_scale_sigma: float
) -> FloatArray:
    r"""Return the covariances of positions (N, 3, 3) by the global bundle adjustment, with what it does not model [m²].

    To the scatter of the tracks the errors of images are added that all tracks of a drive share: with r the place relative to
    the first pose and s the travel,

    .. math:: C + σ_{step}^2 s I + φ(s)^2 (|r|^2 I - r r^T) + σ_{scale}^2 r r^T, \qquad φ(s)^2 = φ_0^2 + w^2 s

    where φ_0 is the tilt, w the walk of the heading, and errors of bridged steps and turns are added up.
    """
    images, odometry = config.images, visual.odometry
    path = dead_reckoning(odometry, np.zeros(3))
    travel = np.r_[0.0, np.cumsum(np.linalg.norm(odometry.step, axis=1))]
    step, turn = (
        np.zeros(len(path)) if errors is None else np.r_[0.0, np.cumsum(errors**2)]
        for errors in (odometry.step_sigma_m, odometry.turn_sigma_rad)
    )
    tilt_deg = np.hypot(images.tilt_bias_sigma_deg, images.tilt_sigma_deg)
    walk = np.radians(images.heading_walk_deg_sqrt_m) ** 2 * travel
    swing = np.radians(tilt_deg) ** 2 + walk + turn
    along = path[:, :, None] * path[:, None, :]
    across = (path**2).sum(axis=1)[:, None, None] * np.eye(3) - along
    own = (images.step_sigma_m**2 * travel + step)[:, None, None] * np.eye(3)
    scale = images.scale_sigma**2 + wheel_scale_sigma**2
    return np.asarray(visual.adjusted_covariance + own + swing[:, None, None] * across + scale * along)


class _Clock:
    """Error along a path (N, 3) [m] by the offset between the clocks of fixes and images."""

    def __init__(self, time_s: FloatArray, path: FloatArray, sigma_s: float) -> None:
        ends = [np.clip(time_s + half_s, *time_s[[0, -1]]) for half_s in (-_HALF_S, _HALF_S)]
        before, after = (_at(end_s, time_s, path) for end_s in ends)
        self._time_s = time_s
        self._along_m = sigma_s * (after - before) / np.maximum(ends[1] - ends[0], _HALF_S)[:, None]

    def at(self, time_s: float) -> FloatArray:
        """Return the standard deviation (3,) at a time, in the direction of motion [m]."""
        along_m: FloatArray = _at(np.array([time_s]), self._time_s, self._along_m)[0]
        return along_m

    def covariance(self, turned_rad: FloatArray) -> FloatArray:
        """Return the covariances (N, 3, 3) of the poses, whose frames are turned by so much [m²]."""
        level = np.zeros_like(turned_rad)
        turn = rotations(np.column_stack([level, level, turned_rad]))
        along_m = np.einsum("nij,nj->ni", turn, self._along_m)
        return np.asarray(along_m[:, :, None] * along_m[:, None, :])


_FIX, _HEIGHT, _POSE = range(3)


def _events(recording: OdometryRecording, with_heights: bool) -> list[tuple[float, int, int]]:
    """Return time, kind and index of all records, fixes and heights before the pose of the same time."""
    poses_s = recording.odometry.time_s
    times = {_POSE: poses_s, _FIX: recording.gps.time_s}
    if with_heights and recording.barometer is not None:
        times[_HEIGHT] = recording.barometer.time_s
    events = [
        (float(at_s), kind, index)
        for kind, moments in times.items()
        for index, at_s in enumerate(moments.tolist())
        if poses_s[0] <= at_s <= poses_s[-1]
    ]
    return sorted(events)


class _Walk:
    """Prediction steps of a filter along the dead-reckoned path."""

    def __init__(
        self,
        recording: OdometryRecording,
        path: FloatArray,
        moments_s: FloatArray,
        config: LocalizationConfig,
    ) -> None:
        odometry, wheels = recording.odometry, recording.wheels
        seconds = np.diff(moments_s, prepend=odometry.time_s[0])
        along = [*path.T, np.unwrap(odometry.attitude_rad[:, 2])]
        along.append(np.r_[0.0, np.cumsum(signed_travel(odometry))])
        for errors in (odometry.step_sigma_m, odometry.turn_sigma_rad):
            squares = np.zeros(len(odometry.step)) if errors is None else errors**2
            along.append(np.r_[0.0, np.cumsum(squares)])
        moved = _at(moments_s, odometry.time_s, np.column_stack(along))
        moved = np.diff(moved, axis=0, prepend=moved[:1])
        self._step, self._turned_rad, self._travel_m = moved[:, :3], moved[:, 3], moved[:, 4]
        self._unseen = np.sqrt(np.maximum(moved[:, 5:], 0.0))
        turning_m = config.turn_sigma_m * np.sqrt(np.abs(self._turned_rad))
        self._unseen[:, 0] = np.hypot(self._unseen[:, 0], turning_m)
        self._beyond_rad = _beyond(recording, moments_s, config)
        self._seconds = seconds
        self._rolled: FloatArray | None = None
        if wheels is not None:
            travel = np.interp(moments_s, wheels.time_s, 0.5 * (wheels.left_m + wheels.right_m))
            rolled = np.diff(travel, prepend=travel[:1])
            # Tracks spin when they set off.
            is_reported = (moments_s <= wheels.time_s[-1] + 1.0) & (travel - travel[0] > _SET_OFF_M)
            self._rolled = np.where(is_reported, rolled, np.nan)

    def on(self, k: int, filtered: ParticleFilter) -> None:
        """Predict the filter to the k-th record."""
        if self._seconds[k] <= 0.0:
            return
        beyond_rad = float(self._beyond_rad[k])
        turn = GyroTurn(beyond_rad, float(self._turned_rad[k])) if np.isfinite(beyond_rad) else None
        filtered.move(self._step[k], self._seconds[k], self._unseen[k, 0], self._unseen[k, 1], turn)
        if self._rolled is not None and np.isfinite(self._rolled[k]):
            rolled = self._rolled[k], self._travel_m[k], self._turned_rad[k]
            filtered.roll(*(float(value) for value in rolled))


def _beyond(recording: OdometryRecording, moments_s: FloatArray, config: LocalizationConfig) -> FloatArray:
    """Return the turn of the gyro relative to the odometry before each record [rad]; NaN where it is not used."""
    if recording.inertial is None or not GyroErrors.of(config).is_used:
        return np.full(len(moments_s), np.nan)
    beyond = gyro_residual_rad(recording.inertial, recording.odometry)
    parts = np.column_stack([np.nan_to_num(beyond), np.isnan(beyond)])
    summed = np.vstack([np.zeros(2), np.cumsum(parts, axis=0)])
    moved = np.diff(_at(moments_s, recording.odometry.time_s, summed), axis=0, prepend=np.zeros((1, 2)))
    return np.where(moved[:, 1] > 0.0, np.nan, moved[:, 0])


def _at(time_s: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(time_s, times, column) for column in values.T])
