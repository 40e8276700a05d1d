"""Empirical Bayes fit of odometry errors where odometry and fixes disagree beyond both claims."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.recording import OdometryRecording
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import OnlinePath, select_fixes
from vision_slam.fusion.receiver.base_station import stated_errors
from vision_slam.fusion.smoother import log_evidence, node_spacing_m, smooth
from vision_slam.inertial.gyro import GyroErrors

logger = logging.getLogger(__name__)

# Errors that are tried, by setting, from the assumed ones upwards.
_LEVELS: dict[str, tuple[float, ...]] = {
    "scale_wander_sigma": (0.03, 0.06, 0.12, 0.25, 0.5),
    "heading_walk_deg_sqrt_m": (0.15, 0.6, 2.4, 9.6),
    "step_sigma_m": (0.05, 0.2, 0.8),
}
# Scale that is wrong by a lens or a focal length varies over a bend, not over steps.
_WANDER_M = 20.0
# Log likelihood that a wider error must gain, also for each fix of a long drive.
_CONVINCING, _MISFIT = 10.0, 0.02
# Refused fixes at the end of a drive that count as a contradiction.
_LEAST_RUN = 2
# Log prior of a receiver that jumps: how seldom, and over how many metres.
_JUMPS = -15.0
_ROUNDS = 3
# Memories of the receiver that are tried, over the assumed one, and the log likelihood that one must gain.
_LONGER, _LONGER_GAIN = (4.0, 16.0), 2.0
# Shares of the assumed error of turns that are tried, and the log likelihood that one must gain.
_SMALLER, _SMALLER_GAIN = (0.5, 0.25), 1.0
# Squared Mahalanobis distance of a refused fix that agrees after all (χ² of two dimensions, 99 %).
_GATE = 9.21


@dataclass(frozen=True)
class Agreement:
    """Errors of the odometry with which it agrees with the fixes, and the fixes to use.

    ``config`` with the errors, ``used`` (M,) whether each fix is used, ``gain`` the log
    likelihood that the wider errors gain over the assumed ones, 0 where those stay.
    """

    config: LocalizationConfig
    used: BoolArray
    gain: float = 0.0

    @property
    def note(self) -> str:
        """One sentence on the disagreement and the errors that resolve it."""
        errors = self.config
        return (
            f"odometry and fixes disagree beyond their assumed errors (a log likelihood of {self.gain:.0f}); the odometry "
            f"was given errors of {100.0 * errors.scale_wander_sigma:.0f} % in scale, "
            f"{errors.heading_walk_deg_sqrt_m:g} deg/√m in heading and {errors.step_sigma_m:g} m/√m in its steps: check focal "
            "length, lens distortion, order of the images and times"
        )


def reconcile(
    recording: OdometryRecording, path: FloatArray, config: LocalizationConfig, online: OnlinePath
) -> Agreement:
    r"""Fit the errors of the odometry to the fixes, where the assumed ones contradict them.

    Scale, heading and steps are given larger errors, level by level, as long as the evidence of
    the smoother grows (type-II maximum likelihood). Fixes that the filter refused and that agree
    again later are errors of the receiver and are left out, unless they are most of all. Fixes that are
    refused to the end of the drive are either a jump of the receiver or an error of the odometry: the jump is the
    evidence with these fixes moved back by a constant offset, times the prior probability of a
    jump. Without a refusal at the end, wider errors must gain a log likelihood of 10.

    Parameters
    ----------
    recording : OdometryRecording
        Odometry and fixes.
    path : (N, 3) ndarray
        Dead-reckoned positions [m].
    config : LocalizationConfig
        Errors assumed of the sensors.
    online : OnlinePath
        Result of the filter with these errors.

    Returns
    -------
    Agreement
        The assumed errors and the accepted fixes where nothing contradicts them.
    """
    tail = _refused_tail(recording, online)
    used = online.accepted | tail
    if used.sum() < recording.gps.LEAST:
        return Agreement(config, online.accepted)
    chosen = _Comparison(select_fixes(recording, used), path)
    wider, gain = _fitted(chosen, config)
    if not tail.any() and gain < max(_CONVINCING, _MISFIT * int(used.sum())):
        return Agreement(config, used)
    back = _jumped_back(recording, path, config, online.accepted, tail)
    if back is not None:
        jumped = _Comparison(back, path).evidence(config, like=wider) + _JUMPS
        if jumped > chosen.evidence(wider, like=wider):
            return Agreement(config, online.accepted)
    return Agreement(wider, _readmitted(recording, path, wider, used), gain)


@dataclass(frozen=True)
class _Comparison:
    """Evidence of configurations over the same records and the same nodes."""

    recording: OdometryRecording
    path: FloatArray

    def evidence(self, config: LocalizationConfig, like: LocalizationConfig) -> float:
        """Return the log evidence of a configuration at the nodes of another, whose errors are not smaller."""
        length_m = float(np.linalg.norm(np.diff(self.path, axis=0), axis=1).sum())
        fine = config.model_copy(update={"node_spacing_m": node_spacing_m(length_m, like)})
        return log_evidence(self.recording, self.path, fine)

    def gain(self, wider: LocalizationConfig, config: LocalizationConfig) -> float:
        """Return the log evidence that other errors gain, at the nodes of these."""
        return self.evidence(wider, like=wider) - self.evidence(config, like=wider)


def agrees_better_delayed(
    recording: OdometryRecording, path: FloatArray, config: LocalizationConfig, delay_s: float
) -> bool:
    """Test whether a delay of the fixes explains a disagreement better than larger errors of the odometry do.

    Odometry that is wrong in a turn resembles odometry that is late. The errors of the odometry are fitted to
    the fixes as they are and to the fixes moved by the delay; the delay must gain a log likelihood of 10, or
    0.02 for each fix of a long drive.

    Parameters
    ----------
    recording : OdometryRecording
        Odometry and fixes.
    path : (N, 3) ndarray
        Dead-reckoned positions [m].
    config : LocalizationConfig
        Errors assumed of the sensors.
    delay_s : float
        Delay of the fixes [s].

    Returns
    -------
    bool
        Whether it does.
    """
    gps, (first_s, last_s) = recording.gps, recording.odometry.time_s[[0, -1]]
    beyond_s = abs(delay_s)
    common = gps.select((gps.time_s >= first_s + beyond_s) & (gps.time_s <= last_s - beyond_s))
    moved = replace(common, time_s=common.time_s - delay_s)
    chosen = [_Comparison(replace(recording, gps=fixes), path) for fixes in (common, moved)]
    fitted = [_fitted(comparison, config)[0] for comparison in chosen]
    widest = config.model_copy(
        update={
            name: max(getattr(errors, name) for errors in fitted) for name in (*_LEVELS, "scale_wander_m")
        }
    )
    as_it_is, delayed = (
        comparison.evidence(errors, like=widest) for comparison, errors in zip(chosen, fitted, strict=True)
    )
    return delayed - as_it_is > max(_CONVINCING, _MISFIT * len(common))


def fitted_memory_s(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> float:
    """Return the correlation time of the fixes' errors [s]: the assumed one, or 4 or 16 times it by evidence.

    One that is too short makes all covariances too small; one that is too long costs little. A
    longer one is therefore taken where it gains a log likelihood of 2.
    """
    best_s = config.gps_correlation_time_s
    best = log_evidence(recording, path, config) + _LONGER_GAIN
    for longer in _LONGER:
        trial_s = longer * config.gps_correlation_time_s
        trial = config.model_copy(update={"gps_correlation_time_s": trial_s})
        found = log_evidence(recording, path, trial)
        if found > best:
            best_s, best = trial_s, found
    return best_s


def fitted_turn_sigma_m(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> float:
    """Return the random error of turns [m/√rad]: the assumed one, or a half or a quarter of it by evidence.

    It is assumed for drives whose lens is less exact than that of most. A smaller one is taken
    where it gains a log likelihood of 1, which only precise fixes show.
    """
    best_m, best = config.turn_sigma_m, _SMALLER_GAIN
    chosen = _Comparison(recording, path)
    for share in _SMALLER:
        trial = config.model_copy(update={"turn_sigma_m": share * config.turn_sigma_m})
        gain = chosen.gain(trial, config)
        if gain > best:
            best_m, best = trial.turn_sigma_m, gain
    return best_m


def _refused_tail(recording: OdometryRecording, online: OnlinePath) -> BoolArray:
    """Return which fixes were refused at the end of the path, or at its start, without one accepted beyond.

    Where more fixes were refused than accepted in between, these are all that were refused: so many are no
    errors of the receiver alone.
    """
    time_s, path_s = recording.gps.time_s, recording.odometry.time_s
    inside = np.flatnonzero((time_s >= path_s[0]) & (time_s <= path_s[-1]))
    tail = np.zeros(len(time_s), dtype=np.bool_)
    accepted = np.flatnonzero(online.accepted[inside])
    if len(accepted) == 0 or accepted[-1] - accepted[0] + 1 > 2 * len(accepted):
        tail[inside] = ~online.accepted[inside]
        return tail
    for run in (inside[: accepted[0]], inside[accepted[-1] + 1 :]):
        if len(run) >= _LEAST_RUN:
            tail[run] = True
    return tail


def _fitted(chosen: _Comparison, config: LocalizationConfig) -> tuple[LocalizationConfig, float]:
    """Return the errors of largest evidence, by coordinate ascent from the assumed ones, and their gain.

    The first round leaves a setting at its first level that gains nothing; where it shows a
    disagreement, the next ones try all levels.
    """
    best, total = config, 0.0
    for _ in range(_ROUNDS):
        before = total
        for setting in _LEVELS:
            for trial in _wider(best, config, setting):
                gain = chosen.gain(trial, best)
                if gain > 0.0:
                    best, total = trial, total + gain
                elif before < _CONVINCING:
                    break
        if total == before:
            break
    return best, total


def _wider(
    best: LocalizationConfig, assumed: LocalizationConfig, setting: str
) -> Iterator[LocalizationConfig]:
    """Yield configurations in which one error is larger than in the best so far, level by level.

    Headings without a random walk keep none: with one the smoother would use the gyro too, and evidence
    over other records cannot be compared.
    """
    if setting == "heading_walk_deg_sqrt_m" and not GyroErrors.of(assumed).is_used:
        return
    now = getattr(best, setting)
    for level in _LEVELS[setting]:
        if level > max(now, getattr(assumed, setting)):
            changed = {setting: level}
            if setting == "scale_wander_sigma":
                changed["scale_wander_m"] = max(_WANDER_M, assumed.scale_wander_m)
            yield best.model_copy(update=changed)


def _jumped_back(
    recording: OdometryRecording,
    path: FloatArray,
    config: LocalizationConfig,
    accepted: BoolArray,
    tail: BoolArray,
) -> OdometryRecording | None:
    """Return the recording as if the receiver had jumped by a constant offset before the refused fixes."""
    if not tail.any() or accepted.sum() < recording.gps.LEAST:
        return None
    smoothed = smooth(select_fixes(recording, accepted), path, config).position
    gps = recording.gps
    there = np.column_stack([np.interp(gps.time_s, recording.odometry.time_s, axis) for axis in smoothed.T])
    offset = np.median((gps.position - there)[tail], axis=0)
    moved = replace(gps, position=gps.position - tail[:, None] * offset)
    return select_fixes(replace(recording, gps=moved), accepted | tail)


def _readmitted(
    recording: OdometryRecording, path: FloatArray, config: LocalizationConfig, used: BoolArray
) -> BoolArray:
    """Return the used fixes and those refused ones that agree with the path and its errors after all."""
    gps, odometry = recording.gps, recording.odometry
    smoothed = smooth(select_fixes(recording, used), path, config)
    at = np.column_stack([np.interp(gps.time_s, odometry.time_s, axis) for axis in smoothed.position.T])
    nearest = np.searchsorted(0.5 * (odometry.time_s[1:] + odometry.time_s[:-1]), gps.time_s)
    variance = (config.gps_bias_sigma_m**2 + config.gps_white_sigma_m**2) * stated_errors(gps, config) ** 2
    own = variance[:, None, None] * np.eye(2)
    off = (gps.position - at)[:, :2]
    spread = smoothed.covariance[nearest, :2, :2] + own
    squared = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[:, :, None])[:, :, 0])
    inside = (gps.time_s >= odometry.time_s[0]) & (gps.time_s <= odometry.time_s[-1])
    readmitted: BoolArray = used | (inside & (squared < _GATE))
    return readmitted
