"""Wheels that spin: told from the height at which the ground appears below the camera."""

import numpy as np

from survey.arrays import FloatArray

_AHEAD, _ASIDE = (0.4, 3.5), 1.4  # patch of ground that is looked at, in heights of the camera
_LEAST_POINTS = 8
_MEMORY_M = 3.0
_SLIPPING = 0.08


class SlipWatch:
    """Ratio of the body's travel to the wheels', from the known height of the camera.

    One camera sees shapes, not sizes; but the ground just ahead must lie as far below the
    camera as it is mounted, h₀. If the map puts it h below, the map's lengths are too long
    by h / h₀, and the wheels' by (wheel travel · h₀) / (map travel · h). The ratio is
    averaged over 3 m of travel. Bumps and slope under the patch make it err by several per
    cent, so it is believed only where it says that more than 8 % of the wheels' travel is
    slip; below that the wheels know better.
    """

    def __init__(self, height_m: float) -> None:
        self._height_m = height_m
        self._log_ratio = 0.0

    @property
    def factor(self) -> float:
        """What the wheels' travel is to be multiplied by."""
        return float(np.exp(self._log_ratio)) if abs(self._log_ratio) > _SLIPPING else 1.0

    def observe(self, points: FloatArray, travel_m: float, rolled_m: float) -> None:
        """Take ground points (N, 3) in the body frame, and the last travel by map and by wheels [m]."""
        height = self._height_m
        near = (np.abs(points[:, 1]) < _ASIDE * height) & (
            (points[:, 0] > _AHEAD[0] * height) & (points[:, 0] < _AHEAD[1] * height)
        )
        if near.sum() < _LEAST_POINTS or rolled_m < 0.02 or travel_m < 0.005:
            return
        seen = height - float(np.median(points[near, 2]))
        if not 0.3 * height < seen < 3.0 * height:
            return
        ratio = np.log(travel_m * height / (rolled_m * seen))
        share = 1.0 - np.exp(-rolled_m / _MEMORY_M)
        self._log_ratio += share * float(np.clip(ratio - self._log_ratio, -0.5, 0.5))
