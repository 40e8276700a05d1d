"""Differential corrections: GPS and barometer relative to a base station at the start."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.recording import Recording
from survey.data.sensors.aiding import GpsFixes
from vision_slam.config import LocalizationConfig


def differenced_fixes(
    recording: Recording, config: LocalizationConfig
) -> tuple[FloatArray, LocalizationConfig]:
    """Return the fixes (N, 3), less what a base station at the start says of the errors that both receivers have.

    The second is what is then to be assumed of them.
    """
    fixes, base = recording.gps, recording.base
    if base is None:
        return fixes.position, config
    common = base.position - recording.start
    position = fixes.position - np.column_stack(
        [np.interp(fixes.time_s, base.time_s, error) for error in common.T]
    )
    left = {
        "gps_bias_sigma_m": config.gps_bias_sigma_m * config.base_residual,
        "gps_white_sigma_m": config.gps_white_sigma_m * float(np.sqrt(2.0)),
    }
    return position, config.model_copy(update=left)


def differenced_heights(
    recording: Recording, config: LocalizationConfig
) -> tuple[FloatArray | None, LocalizationConfig]:
    """Return the barometer's heights (N,), less the weather that one at the start felt, and what is to be assumed of them."""
    readings, base = recording.barometer, recording.base_barometer
    if readings is None:
        return None, config
    if base is None:
        return readings.height_m, config
    weather = np.interp(readings.time_s, base.time_s, base.height_m - base.height_m[0])
    left = {
        "barometer_drift_sigma_m": config.barometer_drift_sigma_m * config.base_barometer_residual,
        "barometer_white_sigma_m": config.barometer_white_sigma_m * float(np.sqrt(2.0)),
    }
    return readings.height_m - weather, config.model_copy(update=left)


def stated_errors(gps: GpsFixes, config: LocalizationConfig) -> FloatArray:
    """Return the errors of fixes (N,) over those that the configuration assumes; 1 where the receiver states none."""
    if gps.sigma_m is None:
        return np.ones(len(gps))
    assumed_m = float(np.hypot(config.gps_bias_sigma_m, config.gps_white_sigma_m))
    ratio: FloatArray = gps.sigma_m / assumed_m
    return ratio
