"""Readings of a science payload along a simulated drive: rate, first-order lag and noise of each sensor."""

from pathlib import Path

import numpy as np

from sim.config.mission import MissionConfig
from sim.config.payload import PayloadConfig
from sim.world.payload_field import PayloadField
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors.payload import PayloadLog
from survey.data.truth import Truth

_STEPS_PER_LAG = 10.0


def record_payload(truth: Truth, mission: MissionConfig, folder: Path) -> None:
    """Write the log of every quantity of a drive's payload as ``<name>.csv`` into a new folder."""
    folder.mkdir()
    for config in mission.payload:
        field = PayloadField(config, truth.dem, mission.site_seed)
        payload_log(config, field, truth, mission.seed).write(folder / f"{config.name}.csv")


def payload_log(config: PayloadConfig, field: PayloadField, truth: Truth, seed: int) -> PayloadLog:
    """Return the readings of one sensor on a drive.

    Parameters
    ----------
    config : PayloadConfig
        Rate, lag and noise.
    field : PayloadField
        The quantity over the site.
    truth : Truth
        Real path of the drive.
    seed : int
        Seed of the rover's errors.

    Returns
    -------
    PayloadLog
        With times; the estimator finds the places.
    """
    path = truth.trajectory
    time_s = np.arange(path.time_s[0], path.time_s[-1] + 1e-9, 1.0 / config.rate_hz)
    shown = _followed(config, field, truth, time_s)
    noise = config.noise_sd * stream(seed, "payload", config.name, "noise").standard_normal(len(time_s))
    return PayloadLog(config, shown + noise, time_s)


def _followed(config: PayloadConfig, field: PayloadField, truth: Truth, time_s: FloatArray) -> FloatArray:
    """Return what a sensor that follows its surroundings with a lag shows at times (N,)."""
    path = truth.trajectory
    if config.lag_s == 0.0:
        return field.at(_places(truth, time_s))
    step_s = min(1.0 / config.rate_hz, config.lag_s / _STEPS_PER_LAG)
    fine_s = np.arange(path.time_s[0], time_s[-1] + step_s, step_s)
    around = field.at(_places(truth, fine_s))
    share = 1.0 - np.exp(-step_s / config.lag_s)
    state = np.empty(len(fine_s))
    state[0] = around[0]
    for k in range(1, len(fine_s)):
        state[k] = state[k - 1] + share * (around[k - 1] - state[k - 1])
    return np.interp(time_s, fine_s, state)


def _places(truth: Truth, time_s: FloatArray) -> FloatArray:
    path = truth.trajectory
    return np.column_stack([np.interp(time_s, path.time_s, axis) for axis in path.position[:, :2].T])
