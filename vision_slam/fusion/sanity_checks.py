"""Sanity checks of start and fixes: wrong surveyed start, delayed or repeated fixes."""

import logging
from dataclasses import replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.recording import OdometryRecording
from survey.data.sensors.aiding import GpsFixes
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import log_evidence

logger = logging.getLogger(__name__)

_LONG_ENOUGH_M = 10.0
# Fixes of 3 m that last a minute lay a start within 7 m by so long a way; over kilometres a path bends by more.
_HOLDS_SHAPE_M = 300.0
_REFUTED_SIGMAS = 5.0
_OUTLYING_M = 2.0
_LAGS_S = np.arange(0.5, 4.01, 0.5)
_CONVINCING, _MISFIT = 10.0, 0.02  # the latter a fix: what assumed errors misjudge grows with the drive
_SHORTER_MEMORIES = (1.0, 0.5, 0.25, 0.125)


def check_start_by_fixes(
    recording: OdometryRecording, path: FloatArray, time_s: FloatArray, config: LocalizationConfig
) -> tuple[OdometryRecording, LocalizationConfig]:
    """Check a surveyed start against the fixes of the first 300 m.

    The path is aligned with the fixes by rotation and shift, robust to outliers. If its start
    is more than five standard deviations of a fix from the surveyed one, the start is taken
    from the fixes, counts as unknown, and a warning is logged.

    Parameters
    ----------
    recording : Recording
        With `start` and fixes.
    path : (N, 3) array_like
        Reckoned from that start, under any heading [m].
    time_s : (N,) array_like
        Times of its poses.
    config : LocalizationConfig
        Errors assumed of receiver and start.

    Returns
    -------
    recording : OdometryRecording
        With the start to use.
    config : LocalizationConfig
        With ``start="unknown"`` where the start was replaced.
    """
    if config.start != "surveyed":
        return recording, config
    begun = _laid_start(path, time_s, recording.gps)
    if begun is None:
        return recording, config
    begun = begun - [0.0, 0.0, recording.antenna_height_m]
    off_m = float(np.hypot(*(begun - recording.start)[:2]))
    sigma_m = float(np.hypot(config.gps_bias_sigma_m, config.gps_white_sigma_m))
    if off_m < _REFUTED_SIGMAS * sigma_m + 3.0 * config.start_sigma_m:
        return recording, config
    logger.warning(
        "the fixes put the start %.0f m from where it was surveyed; it is taken for unknown, check the start of the recording",
        off_m,
    )
    return replace(recording, start=begun), config.model_copy(update={"start": "unknown"})


def fix_delay_s(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> float:
    r"""Estimate the delay of the fixes [s] by the likelihood of the smoother; 0 unless it is significant.

    A receiver that filters or a slow link reports an earlier position. On a straight line the
    delay is unobservable; in turns path and fixes separate. Delays of 0.5 to 4 s are tried. One
    is accepted if it gains a log likelihood of 10, or 0.02 per fix on long drives, and if a
    longer one gains less. Outliers must be removed before. Errors with a shorter correlation
    time than assumed may look like a delay, so the gain must also hold with the correlation
    time, or its half, quarter or eighth, that fits best. Over kilometres, fixes without delay of
    development missions gained up to 18 by chance.
    """
    least = log_evidence(recording, path, config)
    gains = [log_evidence(_earlier(recording, lag), path, config) - least for lag in _LAGS_S]
    best = int(np.argmax(gains))
    convincing = max(_CONVINCING, _MISFIT * len(recording.gps))
    if gains[best] < convincing or best == len(gains) - 1:
        return 0.0
    late = _with_any_memory(_earlier(recording, _LAGS_S[best]), path, config)
    if late - _with_any_memory(recording, path, config) < convincing:
        return 0.0
    logger.warning(
        "the fixes come about %.1f s late (a log likelihood of %.0f more); they are moved back in time",
        _LAGS_S[best],
        gains[best],
    )
    return float(_LAGS_S[best])


def remove_repeated_fixes(gps: GpsFixes) -> GpsFixes:
    """Remove fixes that repeat the one before to the last digit: the receiver froze or was polled too often.

    Examples
    --------
    >>> place = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [1.0, 0.1, 0.0], [3.0, 0.0, 0.1]])
    >>> remove_repeated_fixes(GpsFixes(np.arange(4.0), place)).time_s.tolist()
    [0.0, 1.0, 3.0]
    """
    new = np.r_[True, (np.diff(gps.position, axis=0) != 0.0).any(axis=1)]
    if new.all() or new.sum() < gps.LEAST:
        return gps
    logger.warning("%d fixes repeat the one before to the last digit and are left out", int((~new).sum()))
    return replace(gps, time_s=gps.time_s[new], position=gps.position[new])


def _with_any_memory(recording: OdometryRecording, path: FloatArray, config: LocalizationConfig) -> float:
    """Return the log evidence with the correlation time of the fixes that makes it largest."""
    assumed_s = config.gps_correlation_time_s
    return max(
        log_evidence(recording, path, config.model_copy(update={"gps_correlation_time_s": share * assumed_s}))
        for share in _SHORTER_MEMORIES
    )


def _earlier(recording: OdometryRecording, lag_s: float) -> OdometryRecording:
    return replace(recording, gps=replace(recording.gps, time_s=recording.gps.time_s - lag_s))


def _laid_start(path: FloatArray, time_s: FloatArray, gps: GpsFixes) -> FloatArray | None:
    """Return the start of the path aligned with the fixes; None where it is too short for a heading."""
    travel = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))]
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
