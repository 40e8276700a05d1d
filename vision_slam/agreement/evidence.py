"""Fits of assumed errors by the evidence of the smoother (type-II maximum likelihood)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.recording import OdometryRecording
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import log_evidence, node_spacing_m
from vision_slam.inertial.gyro import GyroErrors

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
# Log likelihood that a wider error must gain, also for each fix of a long drive.
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
