"""Empirical Bayes fit of odometry errors where odometry and fixes disagree beyond both claims."""

from dataclasses import dataclass, replace

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.recording import OdometryRecording
from vision_slam.agreement.evidence import CONVINCING, MISFIT, EvidenceComparison, fitted_errors
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.online import OnlinePath, select_fixes
from vision_slam.fusion.receiver.base_station import stated_errors
from vision_slam.fusion.smoother import smooth

# Refused fixes at the end of a drive that count as a contradiction.
_LEAST_RUN = 1
# Log prior of a receiver that jumps: how seldom, and over how many metres.
_JUMPS = -15.0
# Correlation times of the receiver that explain a disagreement as well, over the assumed one.
_FASTER = (0.5, 0.25, 0.125, 0.0625)
# Squared Mahalanobis distance of a refused fix that agrees after all (χ² of two dimensions, 99 %).
_GATE = 9.21
# Least variance of a difference in any direction, as a share of the sum of both.
_LEAST_SHARE = 1e-12


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
    chosen = EvidenceComparison(select_fixes(recording, used), path)
    wider, gain = fitted_errors(chosen, config)
    least = max(CONVINCING, MISFIT * int(used.sum()))
    if not tail.any() and gain < least:
        return Agreement(config, used)
    if chosen.evidence(wider, like=wider) < _of_faster_receiver(chosen, config, like=wider):
        return Agreement(config, used)
    back = _jumped_back(recording, path, config, online.accepted, tail)
    if back is not None:
        jumped = EvidenceComparison(back, path).evidence(config, like=wider) + _JUMPS
        if jumped > chosen.evidence(wider, like=wider):
            return Agreement(config, online.accepted)
    return Agreement(wider, _readmitted(recording, path, wider, used), gain)


def _of_faster_receiver(
    chosen: EvidenceComparison, config: LocalizationConfig, like: LocalizationConfig
) -> float:
    """Return the largest evidence of the assumed odometry with a receiver whose errors vary faster than assumed.

    Fixes that vary faster contradict good odometry too. The assumed correlation time remains in use then: one
    that is too long costs little.
    """
    faster = [share * config.gps_correlation_time_s for share in _FASTER]
    trials = [config.model_copy(update={"gps_correlation_time_s": memory_s}) for memory_s in faster]
    return max(chosen.evidence(trial, like=like) for trial in trials)


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
    squared = _squared_distance(off, spread)
    inside = (gps.time_s >= odometry.time_s[0]) & (gps.time_s <= odometry.time_s[-1])
    readmitted: BoolArray = used | (inside & (squared < _GATE))
    return readmitted


def _squared_distance(off: FloatArray, spread: FloatArray) -> FloatArray:
    """Return squared Mahalanobis distances (N,) of differences (N, 2) with covariances (N, 2, 2), singular ones too.

    A covariance that fixes thousands of kilometres away have widened may be singular to its last digit: its shorter axis
    is at least a millionth of the longer one.
    """
    least = _LEAST_SHARE * np.trace(spread, axis1=1, axis2=2)
    solved = np.linalg.solve(spread + least[:, None, None] * np.eye(2), off[:, :, None])
    squared: FloatArray = np.einsum("ni,ni->n", off, solved[:, :, 0])
    return squared
