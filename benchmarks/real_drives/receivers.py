"""Fixes of receivers along a reference path, drawn with errors of known size."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sim.instruments.sensor import gauss_markov
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors.records import GpsFixes
from vision_slam.config import LocalizationConfig

ORIGIN = np.array([500000.0, 6470000.0, 100.0])
_HEADING_DEG = 40.0


@dataclass(frozen=True)
class Receiver:
    """Rate and errors of a receiver: a Gauss-Markov bias and white noise [m], and the error of its clock [s]."""

    rate_hz: float = 1.0
    bias_m: float = 1.0
    bias_time_s: float = 120.0
    white_m: float = 0.5
    late_s: float = 0.0

    def config(self) -> LocalizationConfig:
        """Return the errors that a user states who knows the receiver; its clock is assumed right."""
        return LocalizationConfig(
            gps_bias_sigma_m=self.bias_m,
            gps_correlation_time_s=self.bias_time_s,
            gps_white_sigma_m=self.white_m,
        )

    def fixes(self, time_s: FloatArray, places: FloatArray, seed: int) -> GpsFixes:
        """Draw fixes along places (R, 3) [m] in the world at their times."""
        rng = stream(seed, "real drives", "receiver")
        at_s = np.arange(time_s[0], time_s[-1] + 1e-6, 1.0 / self.rate_hz)
        error = gauss_markov(np.diff(at_s), self.bias_time_s, self.bias_m, rng, 3)
        error = error + self.white_m * rng.standard_normal(error.shape)
        real = np.column_stack([np.interp(at_s, time_s, axis) for axis in places.T])
        return GpsFixes(at_s + self.late_s, real + error * [1.0, 1.0, 1.7])


GPS = Receiver()
RTK = Receiver(bias_m=0.01, bias_time_s=300.0, white_m=0.02)
RTK_10_HZ = Receiver(10.0, bias_m=0.01, bias_time_s=300.0, white_m=0.02)
PHONE = Receiver(bias_m=3.0, bias_time_s=100.0, white_m=1.0)
SCATTERED = Receiver(bias_m=0.3, white_m=3.0)
SCATTERED_5_HZ = Receiver(5.0, bias_m=0.3, white_m=3.0)
LATE = Receiver(late_s=0.5)


def in_world(places: FloatArray) -> FloatArray:
    """Turn places (N, 3) [m] of the reference by 40° and move them into the CRS."""
    turned: FloatArray = Rotation.from_euler("z", _HEADING_DEG, degrees=True).apply(places)
    return np.asarray(turned + ORIGIN)
