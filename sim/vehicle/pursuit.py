"""Path following: pure pursuit for a skid-steered rover, and recovery of a stuck one."""

from collections import deque

import numpy as np

from sim.config.rover import PhysicsConfig
from survey.core import FloatArray

_SPACING_M = 0.1
_SEARCHED_M = 3.0
_HANGS_S, _HANGS_M = 3.0, 0.1
_BACKS_S, _FAST_BACK, _SLOW_BACK = 2.0, -0.7, -0.2
_TRIES, _PLACE_M = 3, 2.0
SKID = 1.8
"""Factor by which the difference of the tracks is larger than rolling without skidding would need."""


def skid_speeds(speed_m_s: float, turn_rate_rad_s: float, config: PhysicsConfig) -> tuple[float, float]:
    """Return the speeds of the left and the right track for a speed and a rate of turn, positive to the left [m/s]."""
    half = 0.5 * SKID * config.track_gauge_m * turn_rate_rad_s
    return speed_m_s - half, speed_m_s + half


class PurePursuit:
    r"""Pure-pursuit controller: steers towards the point of the route one look-ahead distance ahead.

    With the angle α to that point and the look-ahead L the commanded curvature is
    :math:`\kappa = 2 \sin\alpha / L` (Coulter, 1992); the tracks turn at
    :math:`v \mp \omega b s / 2` with ω = κ v, their distance b and a factor s, since tracks
    skid and turn the rover less than their difference implies. Towards a point behind the
    rover turns on the spot.

    `path` (N, 2): waypoints [m]. `speed_m_s`: on straight stretches [m/s]. `config`: look-ahead, tracks,
    fastest turn. `is_complete`: whether the route ends there; if not, `extend` appends to it, and it is not
    done before `complete`.

    >>> pursuit = PurePursuit(np.array([[0.0, 0.0], [10.0, 0.0]]), 1.0, PhysicsConfig())
    >>> left, right = pursuit.track_speeds(np.array([1.0, 0.2]), 0.0)
    >>> bool(left > right)  # it is left of the route and turns right
    True
    """

    def __init__(
        self, path: FloatArray, speed_m_s: float, config: PhysicsConfig, *, is_complete: bool = True
    ) -> None:
        self._speed, self._config = speed_m_s, config
        self._nearest, self._is_complete = 0, is_complete
        self._follow(path)

    def _follow(self, path: FloatArray) -> None:
        """Follow a path of waypoints (N, 2) from now on."""
        self._path = path
        ends = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T))]
        self.length_m = float(ends[-1])
        self._along = np.arange(0.0, self.length_m + _SPACING_M, _SPACING_M).clip(max=self.length_m)
        self._xy = np.column_stack([np.interp(self._along, ends, axis) for axis in path.T])

    @property
    def wants_more(self) -> bool:
        """Whether the route is not complete and its end is no farther than the look-ahead."""
        return not self._is_complete and self.length_m - self.progress_m <= self._config.look_ahead_m

    def extend(self, waypoints: FloatArray) -> None:
        """Append waypoints (K, 2) [m] to the route."""
        self._follow(np.vstack([self._path, waypoints]))

    def complete(self) -> None:
        """End the route where it ends now."""
        self._is_complete = True

    @property
    def progress_m(self) -> float:
        """Progress along the route [m]."""
        return float(self._along[self._nearest])

    def at(self, along_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (N, 2) [m] and headings (N,) [rad] at distances along the route."""
        k = np.clip(np.searchsorted(self._along, along_m), 1, len(self._xy) - 1)
        step = self._xy[k] - self._xy[k - 1]
        return self._xy[k], np.arctan2(step[:, 1], step[:, 0])

    def is_done(self, xy: FloatArray) -> bool:
        """Return whether the end of the route is reached."""
        near = float(np.hypot(*(self._xy[-1] - xy))) <= self._config.goal_radius_m
        return (
            self._is_complete and near and self.length_m - self.progress_m <= 2.0 * self._config.goal_radius_m
        )

    def track_speeds(self, xy: FloatArray, heading_rad: float) -> tuple[float, float]:
        """Return the commanded speeds of the left and the right track at a position (2,) and heading [m/s]."""
        self._advance(xy)
        config = self._config
        ahead = min(self._nearest + round(config.look_ahead_m / _SPACING_M), len(self._xy) - 1)
        east, north = self._xy[ahead] - xy
        angle = (np.arctan2(north, east) - heading_rad + np.pi) % (2.0 * np.pi) - np.pi
        speed = self._speed * max(float(np.cos(angle)), 0.0)
        turn = 2.0 * self._speed * np.sin(angle) / config.look_ahead_m
        if np.cos(angle) < 0.0:
            turn = np.copysign(config.max_turn_rate_rad_s, angle)
        turn = float(np.clip(turn, -config.max_turn_rate_rad_s, config.max_turn_rate_rad_s))
        return skid_speeds(speed, turn, config)

    def _advance(self, xy: FloatArray) -> None:
        """Advance to the nearest point of the next metres, never back."""
        last = self._nearest + round(_SEARCHED_M / _SPACING_M)
        gaps = np.hypot(*(self._xy[self._nearest : last + 1] - xy).T)
        self._nearest += int(np.argmin(gaps))


class BackingOff:
    """Recovery of a stuck rover: it backs off while turning towards its route, and tries again.

    Uphill one track alone may be too weak to turn a rover; rolling back it turns easily. A
    rover is stuck when its estimated position moves less than 0.1 m in 3 s. After three tries
    at one place there is no further one.

    `speed_m_s`: on straight stretches [m/s]; it backs off more slowly.

    >>> backing = BackingOff(1.0)
    >>> asked = [backing.track_speeds(0.1 * k, np.zeros(2), (0.0, 0.6)) for k in range(40)]
    >>> asked[0], asked[-1]  # a turn to the left is commanded: the left track is the faster one in reverse
    ((0.0, 0.6), (-0.7, -0.2))
    """

    def __init__(self, speed_m_s: float) -> None:
        self._speed = speed_m_s
        self._trail: deque[tuple[float, FloatArray]] = deque()
        self._until_s = -np.inf
        self._back = 0.0, 0.0
        self._place, self._n_tries = np.full(2, np.inf), 0

    def track_speeds(self, time_s: float, xy: FloatArray, wanted: tuple[float, float]) -> tuple[float, float]:
        """Return the commanded speeds of both tracks [m/s], where `wanted` would follow the route."""
        if time_s < self._until_s:
            return self._back
        self._trail.append((time_s, xy))
        if time_s - self._trail[0][0] < _HANGS_S:
            return wanted
        before = self._trail.popleft()[1]
        if np.hypot(*(xy - before)) >= _HANGS_M or not self._may_try(xy):
            return wanted
        left, right = wanted
        fast, slow = _FAST_BACK * self._speed, _SLOW_BACK * self._speed
        self._back = (fast, slow) if right > left else (slow, fast)
        self._until_s = time_s + _BACKS_S
        self._trail.clear()
        return self._back

    def _may_try(self, xy: FloatArray) -> bool:
        """Return whether another try is due at a place, and count it."""
        if not np.hypot(*(xy - self._place)) < _PLACE_M:
            self._place, self._n_tries = xy, 0
        self._n_tries += 1
        return self._n_tries <= _TRIES
