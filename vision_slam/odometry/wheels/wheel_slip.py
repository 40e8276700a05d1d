"""Wheel slip detection and wheel scale from the height of the camera."""

import numpy as np

from survey.core.arrays import FloatArray

_AHEAD, _ASIDE = (0.4, 3.5), 1.4  # patch of ground that is looked at, in heights of the camera
_LEAST_POINTS = 8
_MEMORY_M, _RATIO_MEMORY_M = 10.0, 2.0
_SLIPPING = 0.12
_SETTLED = 10  # keyframes after which the map has a size
_LEAST_ROLLED_M, _LEAST_TRAVEL_M = 0.02, 1e-3
_WHEEL_SIGMA = 0.03
# What rough ground makes of the height over 25 m, measured on drives over ground that is known.
_HEIGHT_SIGMA, _HEIGHT_SIGMA_OVER_M = 0.016, 25.0
_OUTLYING, _MOST = 0.1, 0.06


class WheelSlipDetector:
    r"""Comparison of the travel by wheels with that by images, from keyframe to keyframe.

    One camera sees shapes, not sizes; but the ground just ahead must lie as far below the
    camera as it is mounted, h₀. If the map puts it h below, its lengths are too short by
    c = log(h₀ / h). Rough ground gives this an error of a tenth, 1.6 % over 25 m. A Kalman filter
    estimates from it the scale error s of wheels with a standard deviation of 3 %. Beyond 6 % the height is not accepted.

    Where the wheels spin, or skid in a turn, the map keeps the size that it has for some
    metres: with L the travel by images and R that by wheels, that is while

    .. math:: \log(L / R) − s + \bar c < −0.12

    where c is averaged over 10 m, from when the left side falls by as much below its own
    mean over 2 m: a map shrinks slowly, which the wheels correct. Slip below
    that threshold counts as an error of the wheels' scale. As long as the wheels spin, the travel is L,
    which \bar c corrects gradually, once.
    """

    def __init__(self, height_m: float) -> None:
        self._height_m = height_m
        self._log_scale, self._variance = 0.0, _WHEEL_SIGMA**2
        self._size = self._usual_ratio = 0.0
        self._n_seen, self._slid = 0, 1.0
        self.is_slipping = False

    @property
    def share(self) -> float:
        """Factor of the travel by wheels for prediction; includes the current slip."""
        return self.scale * (self._slid if self.is_slipping else 1.0)

    @property
    def scale(self) -> float:
        """Factor of the travel by wheels without slip."""
        return float(np.exp(np.clip(self._log_scale, -_MOST, _MOST)))

    def travel_m(self, rolled_m: float, seen_m: float | None) -> float:
        """Return the travel of the body between two keyframes [m]: by wheels, or by images while they spin.

        Without a travel by images, spin is not detected.
        """
        told_m = self.scale * rolled_m
        if seen_m is None:
            self._n_seen, self.is_slipping = 0, False
        if seen_m is None or rolled_m < _LEAST_ROLLED_M:
            return told_m
        self._n_seen += 1
        seen_m = max(seen_m, _LEAST_TRAVEL_M)
        ratio = float(np.log(seen_m / told_m)) + self._size
        is_new = self._n_seen > _SETTLED and ratio < self._usual_ratio - _SLIPPING
        self.is_slipping = ratio < -_SLIPPING and (self.is_slipping or is_new)
        if self.is_slipping:
            self._slid = min(seen_m / told_m, 1.0)
            return seen_m * float(np.exp(_share(seen_m, _MEMORY_M) * self._size))
        self._usual_ratio += _share(rolled_m, _RATIO_MEMORY_M) * (ratio - self._usual_ratio)
        return told_m

    def observe(self, points: FloatArray, travel_m: float) -> None:
        """Take ground points (N, 3) in the body frame, and the travel since the last ones [m]."""
        height = self._height_m
        near = (np.abs(points[:, 1]) < _ASIDE * height) & (
            (points[:, 0] > _AHEAD[0] * height) & (points[:, 0] < _AHEAD[1] * height)
        )
        if near.sum() < _LEAST_POINTS or travel_m < _LEAST_TRAVEL_M:
            return
        seen = height - float(np.median(points[near, 2]))
        if not 0.3 * height < seen < 3.0 * height:
            return
        size = float(np.log(height / seen))
        self._size += _share(travel_m, _MEMORY_M) * (size - self._size)
        if not self.is_slipping and self._n_seen > _SETTLED:
            noise = _HEIGHT_SIGMA**2 * _HEIGHT_SIGMA_OVER_M / travel_m
            gain = self._variance / (self._variance + noise)
            self._log_scale += gain * float(np.clip(size, -_OUTLYING, _OUTLYING))
            self._variance *= 1.0 - gain


def _share(travel_m: float, memory_m: float) -> float:
    """Return by how much the newest of a running mean counts."""
    return 1.0 - float(np.exp(-travel_m / memory_m))
