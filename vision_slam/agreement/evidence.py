"""Fits of assumed errors by the evidence of the smoother (empirical Bayes, type-II maximum likelihood).

`white_error_m` measures the independent error of fixes. `fitted_errors` raises the errors of the odometry level by level while the log evidence grows; `fitted_memory_s` and
`fitted_turn_sigma_m` fit the correlation time of the fixes and the errors of turns. `reconcile` applies them where odometry
and fixes disagree beyond both claims, and chooses the fixes to use. `is_worse_than_fixes` tests by cross-validation whether
odometry predicts fixes worse than their neighbours do; `along_fixes` then replaces it by lines between the fixes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from survey.core import BoolArray, FloatArray
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import GpsFixes
from vision_slam.attitude import rotations
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.error_terms import stated_errors
from vision_slam.fusion.online import OnlinePath, select_fixes
from vision_slam.fusion.smoother import log_evidence, node_spacing_m, smooth
from vision_slam.motion import GyroErrors

ComplexArray = npt.NDArray[np.complex128]

# Errors that are tried, by setting, from the assumed ones upwards.
_LEVELS: dict[str, tuple[float, ...]] = {
    "scale_wander_sigma": (0.03, 0.06, 0.12, 0.25, 0.5),
    "scale_wander_m": (60.0, 200.0),
    "heading_walk_deg_sqrt_m": (0.15, 0.6, 2.4, 9.6),
    "step_sigma_m": (0.05, 0.2, 0.8),
}
# Scale that is wrong by a lens or a focal length varies over a bend, not over steps. Scale that drifts goes on to drift
# where no fixes are: only a long correlation length says so.
_WANDER_M = 20.0
# Log likelihood that another correlation length must gain: few records tell two that are alike.
_OTHER_LENGTH_GAIN = 2.0
# Log likelihood that a wider error must gain, and that for each fix of a long drive: what assumed errors misjudge grows
# with the drive.
CONVINCING, MISFIT = 10.0, 0.02
_ROUNDS = 3
# Memories of the receiver that are tried, over the assumed one, and the log likelihood that one must gain.
_LONGER, _LONGER_GAIN = (4.0, 16.0), 2.0
# Shares of the assumed error of turns that are tried, and the log likelihood that one must gain.
_SMALLER, _SMALLER_GAIN = (0.5, 0.25), 1.0


@dataclass(frozen=True)
class EvidenceComparison:
    """Evidence of configurations over the same records and the same nodes."""

    recording: OdometryRecording
    path: FloatArray

    @property
    def length_m(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.path, axis=0), axis=1).sum())

    def evidence(self, config: LocalizationConfig, like: LocalizationConfig) -> float:
        """Return the log evidence of a configuration at the nodes of another, whose errors are not smaller."""
        fine = config.model_copy(update={"node_spacing_m": node_spacing_m(self.length_m, like)})
        return log_evidence(self.recording, self.path, fine)

    def gain(self, other: LocalizationConfig, config: LocalizationConfig) -> float:
        """Return the log evidence that other errors gain, at the nodes of those with the closer ones."""
        closer = min(other, config, key=lambda errors: node_spacing_m(self.length_m, errors))
        return self.evidence(other, like=closer) - self.evidence(config, like=closer)


def agrees_better_delayed(
    recording: OdometryRecording, path: FloatArray, config: LocalizationConfig, delay_s: float
) -> bool:
    """Test whether a delay of the fixes explains a disagreement better than larger errors of the odometry do.

    Odometry that is wrong in a turn resembles odometry that is late. The errors of the odometry are fitted to
    the fixes as they are and to the fixes moved by the delay; the delay must gain a log likelihood of 10, or
    0.02 for each fix of a long drive.

    `path` (N, 3): dead-reckoned positions [m]. `delay_s`: delay of the fixes [s].
    """
    gps, (first_s, last_s) = recording.gps, recording.odometry.time_s[[0, -1]]
    beyond_s = abs(delay_s)
    common = gps.select((gps.time_s >= first_s + beyond_s) & (gps.time_s <= last_s - beyond_s))
    moved = replace(common, time_s=common.time_s - delay_s)
    chosen = [EvidenceComparison(replace(recording, gps=fixes), path) for fixes in (common, moved)]
    fitted = [fitted_errors(comparison, config)[0] for comparison in chosen]
    widest = config.model_copy(
        update={name: max(getattr(errors, name) for errors in fitted) for name in _LEVELS}
    )
    as_it_is, delayed = (
        comparison.evidence(errors, like=widest) for comparison, errors in zip(chosen, fitted, strict=True)
    )
    return delayed - as_it_is > max(CONVINCING, MISFIT * len(common))


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


# Fixes of a window about which the path is turned and scaled, the least time between them and the longest of a window [s],
# and the fewest windows.
_IN_WINDOW, _LEAST_APART_S, _LONGEST_WINDOW_S, _LEAST_WINDOWS = 5, 0.9, 20.0, 2


def white_error_m(recording: OdometryRecording, path: FloatArray) -> float | None:
    r"""Return the independent horizontal error of each fix by their second differences about the path [m].

    The path is moved, turned and scaled to the fixes of each window of five, so that neither an unknown heading nor a
    scale that drifts counts. What is left, d, then varies over seconds by the receiver alone:

    .. math::  \sigma^2 = \frac{\mathrm{median} |d_{i-1} - 2 d_i + d_{i+1}|^2}{12 \log 2}

    for complex d whose parts have the variance σ²: squares of second differences are exponentially distributed with the mean
    12 σ². The median tolerates outliers, but each takes part in three differences: where one fix of fourteen is far off, the
    result is a third too large. Errors that last longer than some seconds are not seen.

    `path` (N, 3): dead-reckoned positions [m]. None where fixes are few or far apart.
    """
    time_s, poses_s = recording.gps.time_s, recording.odometry.time_s
    gps = recording.gps.select((time_s >= poses_s[0]) & (time_s <= poses_s[-1]))
    if len(gps) < _IN_WINDOW:
        return None
    x, y = (np.interp(gps.time_s, poses_s, axis) for axis in path[:, :2].T)
    fixes, by_path = gps.position[:, 0] + 1.0j * gps.position[:, 1], x + 1.0j * y
    every = max(int(np.ceil(_LEAST_APART_S / np.median(np.diff(gps.time_s)))), 1)
    squared = []
    for first in range(len(gps) - (_IN_WINDOW - 1) * every):
        window = slice(first, first + _IN_WINDOW * every, every)
        if np.ptp(gps.time_s[window]) <= _LONGEST_WINDOW_S:
            left = _left_by_similarity(fixes[window], by_path[window])
            squared.append(np.abs(np.diff(left, n=2)) ** 2)
    return (
        float(np.sqrt(np.median(squared) / (12.0 * np.log(2.0)))) if len(squared) >= _LEAST_WINDOWS else None
    )


def _left_by_similarity(places: ComplexArray, others: ComplexArray) -> ComplexArray:
    """Return what is left of places (N,) after the best similarity of others (N,); x + i y [m]."""
    places, others = places - places.mean(), others - others.mean()
    extent = float(np.vdot(others, others).real)
    left: ComplexArray = places - (np.vdot(others, places) / extent if extent > 0.0 else 0.0) * others
    return left


def fitted_turn_sigma_m(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> float:
    """Return the random error of turns [m/√rad]: the assumed one, or a half or a quarter of it by evidence.

    It is assumed for drives whose lens is less exact than that of most. A smaller one is taken
    where it gains a log likelihood of 1, which only precise fixes show.
    """
    best_m, best = config.turn_sigma_m, _SMALLER_GAIN
    chosen = EvidenceComparison(recording, path)
    for share in _SMALLER:
        trial = config.model_copy(update={"turn_sigma_m": share * config.turn_sigma_m})
        gain = chosen.gain(trial, config)
        if gain > best:
            best_m, best = trial.turn_sigma_m, gain
    return best_m


def fitted_errors(chosen: EvidenceComparison, config: LocalizationConfig) -> tuple[LocalizationConfig, float]:
    """Return the errors of largest evidence, by coordinate ascent from the assumed ones, and their gain.

    Every round compares all levels of a setting: a slightly larger error may gain nothing where a much larger
    one gains most. A correlation length must gain a log likelihood of 2 over another.
    """
    best, total = config, 0.0
    for _ in range(_ROUNDS):
        before = total
        for setting in _LEVELS:
            least = _OTHER_LENGTH_GAIN if setting == "scale_wander_m" else 0.0
            gains = [(chosen.gain(trial, best), trial) for trial in _others(best, config, setting)]
            gain, trial = max(gains, key=lambda found: found[0], default=(0.0, best))
            if gain > least:
                best, total = trial, total + gain
        if total == before:
            break
    return best, total


def _others(
    best: LocalizationConfig, assumed: LocalizationConfig, setting: str
) -> Iterator[LocalizationConfig]:
    """Yield the best configuration so far with each other level of one error, from the assumed one upwards.

    Headings without a random walk keep none: with one the smoother would use the gyro too, and evidence
    over other records cannot be compared. The assumed error of scale keeps its correlation length.
    """
    is_wandering = best.scale_wander_sigma > assumed.scale_wander_sigma
    is_fixed = {
        "heading_walk_deg_sqrt_m": not GyroErrors.of(assumed).is_used,
        "scale_wander_m": not is_wandering,
    }
    if is_fixed.get(setting, False):
        return
    least = getattr(assumed, setting)
    if setting == "scale_wander_m":
        least = max(_WANDER_M, least)
    for level in (least, *(level for level in _LEVELS[setting] if level > least)):
        if level != getattr(best, setting):
            yield _with_level(best, assumed, setting, level)


def _with_level(
    best: LocalizationConfig, assumed: LocalizationConfig, setting: str, level: float
) -> LocalizationConfig:
    """Return the best configuration so far with another level of one error, and a correlation length that fits it."""
    changed = {setting: level}
    if setting == "scale_wander_sigma":
        is_wider = level > assumed.scale_wander_sigma
        changed["scale_wander_m"] = (
            max(_WANDER_M, best.scale_wander_m) if is_wider else assumed.scale_wander_m
        )
    return best.model_copy(update=changed)


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

    `path` (N, 3): dead-reckoned positions [m].
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


_LEAST_FIXES_ALONE = 5
_STEP_SIGMA_M = 0.3  # error of straight lines between fixes, per square root of a metre [m]
# Columns of the errors of fixes that were left out.
_PATH, _FIXES = slice(1, 3), slice(3, 5)


def is_worse_than_fixes(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> bool:
    """Test by cross-validation whether the smoothed path predicts fixes worse than their neighbours do.

    Every second fix is left out and predicted by the path smoothed with the others, and by linear
    interpolation between the others; then the same with the other half. The first fix and the last are predicted by
    the path beyond the others, and by the mean velocity of the nearest others. In a turn such a velocity is a bad
    prediction, which excuses no path that is worse between fixes: these are compared alone too. The path does not follow
    the slow error of the receiver, which neighbours share: what successive errors by the path have in common does not
    count, up to the assumed variance of that error.

    `path` (N, 3): dead-reckoned positions [m].
    """
    time_s, poses_s = recording.gps.time_s, recording.odometry.time_s
    gps = recording.gps.select((time_s >= poses_s[0]) & (time_s <= poses_s[-1]))
    if len(gps) < _LEAST_FIXES_ALONE:
        return False
    halves = [_held_out(replace(recording, gps=gps), path, config, first) for first in (0, 1)]
    between = [half[(half[:, 0] > 0) & (half[:, 0] < len(gps) - 1)] for half in halves]
    return any(_has_larger_sum(errors, config) for errors in (between, halves))


def _held_out(
    recording: OdometryRecording, path: FloatArray, config: LocalizationConfig, first: int
) -> FloatArray:
    """Return the number of every second fix from the first, and its errors by the path and by its neighbours (M, 5)."""
    gps, poses_s = recording.gps, recording.odometry.time_s
    held = np.zeros(len(gps), dtype=np.bool_)
    held[first::2] = True
    others = gps.select(~held)
    smoothed = smooth(replace(recording, gps=others), path, config).position
    by_path = _prediction_errors(gps, held, poses_s, smoothed)
    by_fixes = _prediction_errors(gps, held, gps.time_s, _extended(gps.time_s, others))
    return np.column_stack([np.flatnonzero(held), by_path, by_fixes])


def _has_larger_sum(halves: list[FloatArray], config: LocalizationConfig) -> bool:
    """Test whether squared errors by the path, without what successive ones have in common, exceed those by fixes."""
    by_path, by_fixes = (
        sum(float((half[:, part] ** 2).sum()) for half in halves) for part in (_PATH, _FIXES)
    )
    common = sum(float((half[1:, _PATH] * half[:-1, _PATH]).sum()) for half in halves)
    slow = sum(half[:, _PATH].size * config.gps_bias_sigma_m**2 for half in halves)
    return by_path - min(max(common, 0.0), slow) > by_fixes


def along_fixes(
    recording: OdometryRecording, config: LocalizationConfig
) -> tuple[OdometryRecording, LocalizationConfig]:
    """Replace the odometry by straight lines between the fixes, with the errors of such lines.

    Roll and pitch stay; the heading is that of the lines.
    """
    odometry, gps = recording.odometry, recording.gps
    level = _extended(odometry.time_s, gps) - [0.0, 0.0, recording.antenna_height_m]
    steps = np.diff(level, axis=0)
    attitude = odometry.attitude_rad.copy()
    attitude[:-1, 2] = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    attitude[-1, 2] = attitude[-2, 2]
    own = np.einsum("nji,nj->ni", rotations(attitude[:-1]), steps)
    straight = Odometry(odometry.time_s, own, attitude)
    errors = config.model_copy(update={"step_sigma_m": _STEP_SIGMA_M, "start": "unknown"})
    return replace(recording, odometry=straight, start=level[0]), errors


def _extended(time_s: FloatArray, gps: GpsFixes) -> FloatArray:
    """Interpolate fixes; before the first and after the last go on at the mean velocity of a second or more."""
    place = np.column_stack([np.interp(time_s, gps.time_s, axis) for axis in gps.position.T])
    for end, other in ((0, min(2, len(gps) - 1)), (-1, max(-3, -len(gps)))):
        velocity = (gps.position[end] - gps.position[other]) / (gps.time_s[end] - gps.time_s[other])
        beyond_s = time_s - gps.time_s[end]
        is_beyond = beyond_s < 0.0 if end == 0 else beyond_s > 0.0
        place[is_beyond] += beyond_s[is_beyond, None] * velocity
    return place


def _prediction_errors(gps: GpsFixes, held: BoolArray, time_s: FloatArray, place: FloatArray) -> FloatArray:
    """Return the horizontal differences (M, 2) of the held-out fixes from a path [m]."""
    at = np.column_stack([np.interp(gps.time_s[held], time_s, axis) for axis in place[:, :2].T])
    errors: FloatArray = gps.position[held, :2] - at
    return errors
