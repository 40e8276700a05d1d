"""Sanity checks of a recording: swapped images, wrong surveyed start, delayed or repeated fixes."""

import logging
from dataclasses import dataclass, replace

import numpy as np

from survey.core import FloatArray, InputError
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import GpsFixes
from vision_slam.agreement.evidence import CONVINCING, MISFIT
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import log_evidence

logger = logging.getLogger(__name__)

_LONG_ENOUGH_M = 10.0
# Fixes of 3 m that last a minute lay a start within 7 m by so long a way; over kilometres a path bends by more.
_HOLDS_SHAPE_M = 300.0
_REFUTED_SIGMAS = 5.0
_OUTLYING_M = 2.0
_LAGS_S = np.arange(0.5, 4.01, 0.5)
_LONGEST_SHARE, _LEAST_FIXES = 0.25, 3  # of the drive; fewer fixes cannot show a delay
# Steps of five images of which the two in the middle are swapped, in steps at constant velocity, and their tolerance.
_SWAPPED_STEPS, _STEP_TOLERANCE = np.array([1.0, 2.0, -1.0, 2.0, 1.0]), 0.3
_SHORTER_MEMORIES = (1.0, 0.5, 0.25, 0.125)


def refuse_swapped_images(odometry: Odometry) -> None:
    """Refuse odometry whose steps show that two neighbouring images are swapped.

    At constant velocity v and equal intervals, steps past a swapped pair are v, 2 v, −v, 2 v, v.

    >>> ahead = np.array([1.0, 1.0, 2.0, -1.0, 2.0, 1.0])
    >>> steps = np.column_stack([ahead, np.zeros(6), np.zeros(6)])
    >>> refuse_swapped_images(Odometry(0.1 * np.arange(7.0), steps, np.zeros((7, 3))))
    Traceback (most recent call last):
    ...
    survey.core.errors.InputError: the images 3 and 4 (0.300 and 0.400 s) are in the wrong order: ...
    """
    steps, times = odometry.step, odometry.time_s
    for k in range(2, len(steps) - 2):
        around, seconds = steps[k - 2 : k + 3], np.diff(times[k - 2 : k + 4])
        velocity = _SWAPPED_STEPS @ around / (_SWAPPED_STEPS @ _SWAPPED_STEPS)
        off = np.linalg.norm(around - _SWAPPED_STEPS[:, None] * velocity, axis=1)
        is_even = np.ptp(seconds) < _STEP_TOLERANCE * seconds.mean()
        if is_even and off.max() < _STEP_TOLERANCE * np.linalg.norm(velocity):
            raise InputError(
                f"the images {k} and {k + 1} ({times[k]:.3f} and {times[k + 1]:.3f} s) are in the wrong order: between them "
                "the motion runs backward, before and after them forward at twice the speed; exchange them or their times."
            )


def check_start_by_fixes(
    recording: OdometryRecording, path: FloatArray, time_s: FloatArray, config: LocalizationConfig
) -> tuple[OdometryRecording, LocalizationConfig]:
    """Check a surveyed start against the fixes of the first 300 m.

    The path is aligned with the fixes by rotation and shift, robust to outliers. If its start
    is more than five standard deviations of a fix and of the reckoned path from the surveyed
    one, the start is taken from the fixes, counts as unknown, and a warning is logged.

    `path` (N, 3): reckoned from that start, under any heading [m]. `time_s` (N,): times of its poses. Returns
    `config`: with ``start="unknown"`` where the start was replaced.
    """
    if config.start != "surveyed":
        return recording, config
    begun = _laid_start(path, time_s, recording.gps)
    if begun is None:
        return recording, config
    begun = begun - [0.0, 0.0, recording.antenna_height_m]
    off_m = float(np.hypot(*(begun - recording.start)[:2]))
    sigma_m = float(np.hypot(config.fix_sigma_m, _reckoned_sigma_m(path, config)))
    if off_m < _REFUTED_SIGMAS * sigma_m + 3.0 * config.start_sigma_m:
        return recording, config
    logger.warning(
        "the fixes put the start %.0f m from where it was surveyed; it is taken for unknown, check the start of the recording",
        off_m,
    )
    return replace(recording, start=begun), config.model_copy(update={"start": "unknown"})


def fix_delay_s(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> float:
    r"""Estimate the delay of the fixes [s] by the likelihood of the smoother; 0 unless it is significant.

    A receiver that filters or a slow link reports an earlier position; a clock that is off does
    so to either side. On a straight line at constant speed the delay is unobservable; in turns
    path and fixes separate. Delays to 4 s, or a quarter of the drive, are tried in steps of 0.5 s
    as long as the likelihood grows. The same fixes are compared at all of them: those that no
    delay moves beyond the drive. A delay is accepted if it gains a log likelihood of 10, or 0.02
    per fix on long drives, and if a longer one gains less. Outliers must be removed before.
    Errors with a shorter correlation time than assumed may look like a delay, so the gain must
    also hold with the correlation time, or its half, quarter or eighth, that fits best. Over
    kilometres, fixes without delay of development missions gained up to 18 by chance.
    """
    shifts = _Shifts.of(recording, path, config)
    if shifts is None:
        return 0.0
    delay_s, gain = max((shifts.best(sign) for sign in (1.0, -1.0)), key=lambda found: found[1])
    convincing = max(CONVINCING, MISFIT * len(recording.gps))
    if gain < convincing:
        return 0.0
    late = _with_any_memory(shifts.moved(delay_s), path, config)
    if late - _with_any_memory(shifts.moved(0.0), path, config) < convincing:
        return 0.0
    delay_s = shifts.refined(delay_s)
    logger.info("the fixes seem to come about %.1f s late (a log likelihood of %.0f more)", delay_s, gain)
    return delay_s


@dataclass(frozen=True)
class _Shifts:
    """A recording with only those fixes that no delay moves beyond its path, to compare delays."""

    recording: OdometryRecording
    path: FloatArray
    config: LocalizationConfig
    lags_s: FloatArray
    unmoved: float

    @classmethod
    def of(
        cls, recording: OdometryRecording, path: FloatArray, config: LocalizationConfig
    ) -> "_Shifts | None":
        """Return the comparison; None for drives too short for one."""
        first_s, last_s = recording.odometry.time_s[[0, -1]]
        lags_s = _LAGS_S[_LONGEST_SHARE * (last_s - first_s) >= _LAGS_S]
        gps = recording.gps
        if len(lags_s) < 2:
            return None
        inside = (gps.time_s >= first_s + lags_s[-1]) & (gps.time_s <= last_s - lags_s[-1])
        if inside.sum() < _LEAST_FIXES:
            return None
        recording = replace(recording, gps=gps.select(inside))
        return cls(recording, path, config, lags_s, log_evidence(recording, path, config))

    def moved(self, lag_s: float) -> OdometryRecording:
        """Return the recording with its fixes earlier by so much."""
        return _earlier(self.recording, lag_s)

    def gain(self, lag_s: float) -> float:
        """Return the log likelihood that a delay gains."""
        return log_evidence(self.moved(lag_s), self.path, self.config) - self.unmoved

    def best(self, sign: float) -> tuple[float, float]:
        """Return the delay to one side with the largest gain, and that gain; (0, 0) where it is the longest."""
        best_s, best = 0.0, 0.0
        for lag_s in (sign * self.lags_s).tolist():
            gain = self.gain(lag_s)
            if gain <= best:
                return best_s, best
            best_s, best = lag_s, gain
        return 0.0, 0.0

    def refined(self, lag_s: float) -> float:
        """Return the vertex of the parabola through the gains at a delay and beside it."""
        before, at, after = (self.gain(lag_s + off_s) for off_s in (-_LAGS_S[0], 0.0, _LAGS_S[0]))
        bend = before - 2.0 * at + after
        return lag_s if bend >= 0.0 else lag_s + 0.5 * float(_LAGS_S[0]) * (before - after) / bend


def remove_repeated_fixes(gps: GpsFixes) -> GpsFixes:
    """Remove fixes that repeat the one before to the last digit: the receiver froze or was polled too often.

    >>> place = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [1.0, 0.1, 0.0], [3.0, 0.0, 0.1]])
    >>> remove_repeated_fixes(GpsFixes(np.arange(4.0), place)).time_s.tolist()
    [0.0, 1.0, 3.0]
    """
    new = np.r_[True, (np.diff(gps.position, axis=0) != 0.0).any(axis=1)]
    if new.all() or new.sum() < gps.LEAST:
        return gps
    logger.warning("%d fixes repeat the one before to the last digit and are left out", int((~new).sum()))
    return gps.select(new)


def _with_any_memory(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> float:
    """Return the log evidence with the correlation time of the fixes that makes it largest."""
    assumed_s = config.gps_correlation_time_s
    return max(
        log_evidence(recording, path, config.model_copy(update={"gps_correlation_time_s": share * assumed_s}))
        for share in _SHORTER_MEMORIES
    )


def _earlier(recording: OdometryRecording, lag_s: float) -> OdometryRecording:
    return replace(recording, gps=replace(recording.gps, time_s=recording.gps.time_s - lag_s))


def _reckoned_sigma_m(path: FloatArray, config: LocalizationConfig) -> float:
    """Return by how much odometry displaces the start of a path whose middle lies right [m]."""
    travel = _travel_m(path)
    used = travel <= _HOLDS_SHAPE_M
    length = float(travel[used][-1])
    lever = float(np.hypot(*(path[used, :2].mean(axis=0) - path[0, :2])))
    walk_deg = config.heading_walk_deg_sqrt_m * np.sqrt(length)
    turned = np.radians(np.hypot(config.yaw_sigma_deg, walk_deg))
    scale = np.hypot(config.scale_sigma, config.scale_wander_sigma)
    return float(np.hypot(lever * np.hypot(scale, turned), config.step_sigma_m * np.sqrt(length)))


def _travel_m(path: FloatArray) -> FloatArray:
    """Return the distance travelled (N,) [m]."""
    travel: FloatArray = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))]
    return travel


def _laid_start(path: FloatArray, time_s: FloatArray, gps: GpsFixes) -> FloatArray | None:
    """Return the start of the path aligned with the fixes; None where it is too short for a heading."""
    travel = _travel_m(path)
    path, time_s = path[travel <= _HOLDS_SHAPE_M], time_s[travel <= _HOLDS_SHAPE_M]
    inside = (gps.time_s >= time_s[0]) & (gps.time_s <= time_s[-1])
    x, y, up = (np.interp(gps.time_s[inside], time_s, axis) for axis in path.T)
    z = x - path[0, 0] + 1j * (y - path[0, 1])
    g = gps.position[inside, 0] + 1j * gps.position[inside, 1]
    if len(z) < 3 or np.abs(z - z.mean()).max() < _LONG_ENOUGH_M:
        return None
    weight, corner = np.ones(len(z)), 0.0j
    for _ in range(20):
        share = weight / weight.sum()
        z_mean, g_mean = share @ z, share @ g
        turn = np.angle((share * (g - g_mean) * (z - z_mean).conj()).sum())
        corner = g_mean - np.exp(1j * turn) * z_mean
        off = np.abs(g - np.exp(1j * turn) * z - corner)
        weight = 1.0 / (1.0 + (off / _OUTLYING_M) ** 2)
    height = float(np.median(gps.position[inside, 2] - up)) + path[0, 2]
    return np.array([corner.real, corner.imag, height])
