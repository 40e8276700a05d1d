"""Follows a route: pure pursuit for a rover that steers by the difference of its tracks."""

import numpy as np

from sim.drive_config import PhysicsConfig
from survey.arrays import FloatArray

_SPACING_M = 0.1
_SEARCHED_M = 3.0


class PurePursuit:
    r"""Steers at the point of the route that lies one look-ahead in front.

    With the angle α to that point and the look-ahead L the curvature asked for is
    :math:`\kappa = 2 \sin\alpha / L` (Coulter, 1992); the tracks turn at
    :math:`v \mp \omega b s / 2` with ω = κ v, their distance b and a factor s, since tracks
    skid and turn the rover less than their difference says. A point behind is turned to on
    the spot.

    Parameters
    ----------
    path : (N, 2) array_like
        Waypoints [m].
    speed_m_s : float
        On straight stretches [m/s].
    config : PhysicsConfig
        Look-ahead, tracks, fastest turn.

    Examples
    --------
    >>> pursuit = PurePursuit(np.array([[0.0, 0.0], [10.0, 0.0]]), 1.0, PhysicsConfig())
    >>> left, right = pursuit.track_speeds(np.array([1.0, 0.2]), 0.0)
    >>> bool(left > right)  # it is left of the route and turns right
    True
    """

    SKID = 1.8

    def __init__(self, path: FloatArray, speed_m_s: float, config: PhysicsConfig) -> None:
        ends = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T))]
        self.length_m = float(ends[-1])
        self._along = np.arange(0.0, self.length_m + _SPACING_M, _SPACING_M).clip(max=self.length_m)
        self._xy = np.column_stack([np.interp(self._along, ends, axis) for axis in path.T])
        self._speed, self._config = speed_m_s, config
        self._nearest = 0

    @property
    def progress_m(self) -> float:
        """How far along the route the rover has come [m]."""
        return float(self._along[self._nearest])

    def at(self, along_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places (N, 2) [m] and headings (N,) [rad] at distances along the route."""
        k = np.clip(np.searchsorted(self._along, along_m), 1, len(self._xy) - 1)
        step = self._xy[k] - self._xy[k - 1]
        return self._xy[k], np.arctan2(step[:, 1], step[:, 0])

    def is_done(self, xy: FloatArray) -> bool:
        """Tell whether the end of the route is reached."""
        near = float(np.hypot(*(self._xy[-1] - xy))) <= self._config.goal_radius_m
        return near and self.length_m - self.progress_m <= 2.0 * self._config.goal_radius_m

    def track_speeds(self, xy: FloatArray, heading_rad: float) -> tuple[float, float]:
        """Return the speeds [m/s] to ask of the left and the right track at a place (2,) and heading."""
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
        half = 0.5 * self.SKID * config.track_gauge_m * turn
        return speed - half, speed + half

    def _advance(self, xy: FloatArray) -> None:
        """Move on to the nearest point of the next metres, never back."""
        last = self._nearest + round(_SEARCHED_M / _SPACING_M)
        gaps = np.hypot(*(self._xy[self._nearest : last + 1] - xy).T)
        self._nearest += int(np.argmin(gaps))
