"""Drive monitor: conditions that end a simulated drive."""

from collections.abc import Sequence

import numpy as np

from sim.config.mission import MissionConfig
from sim.simulate.simulated_drive import Ending
from sim.vehicle.physics import RoverState
from sim.vehicle.pursuit import PurePursuit
from sim.world.fine_terrain import FineTerrain
from survey.core.arrays import FloatArray

LOGGED_HZ = 80
"""States per second that instruments read from."""
STEERED_HZ = 20
"""Steering commands per second, and states per second of the truth."""
STANDING_S = 1.0
"""Time that the rover stands still at the start [s]."""

_TIPPED_COS = np.cos(np.radians(65.0))
_FELL_M = 0.8
_STALLED_S, _STALLED_M = 20.0, 0.5


class DriveMonitor:
    """Finds out whether and how a drive has ended.

    Parameters
    ----------
    ground : FineTerrain
        The ground, with its bounds.
    pursuit : PurePursuit
        Follower of the route.
    mission : MissionConfig
        Speed and battery of the rover.
    """

    def __init__(self, ground: FineTerrain, pursuit: PurePursuit, mission: MissionConfig) -> None:
        self._bounds, self._pursuit = ground.bounds, pursuit
        self._battery_j = mission.rover.battery_j
        self._speed_m_s = mission.rover.speed_m_s

    def ending(self, states: Sequence[RoverState], steered_xy: FloatArray) -> Ending | None:
        """Return how the drive has ended, or None while it goes on.

        `states` are those at `STEERED_HZ` since the start, `steered_xy` (2,) the position that is steered by [m].
        """
        state = states[-1]
        xmin, ymin, xmax, ymax = self._bounds
        x, y, z = state.position
        a_second_ago = states[max(len(states) - 1 - STEERED_HZ, 0)]
        reasons = {
            Ending.LEFT_THE_MAP: not (xmin < x < xmax and ymin < y < ymax),
            Ending.TIPPED_OVER: _upright(state) < _TIPPED_COS,
            Ending.FELL: a_second_ago.position[2] - z > _FELL_M,
            Ending.BATTERY_EMPTY: self._battery_j is not None and state.energy_j > self._battery_j,
            Ending.ARRIVED: self._pursuit.is_done(steered_xy),
            Ending.STALLED: _is_stalled(states),
            Ending.OUT_OF_TIME: state.time_s > 3.0 * self._pursuit.length_m / self._speed_m_s + 60.0,
        }
        return next((ending for ending, is_so in reasons.items() if is_so), None)


def heading_of(state: RoverState) -> float:
    """Return the heading of a state, counter-clockwise from east [rad]."""
    x, y, z, w = state.quaternion
    return float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))


def _is_stalled(states: Sequence[RoverState]) -> bool:
    """Return whether the rover is where it was some time ago."""
    n = round(_STALLED_S * STEERED_HZ)
    if len(states) <= n + STANDING_S * STEERED_HZ:
        return False
    before, now = states[-1 - n].position, states[-1].position
    return bool(np.hypot(now[0] - before[0], now[1] - before[1]) < _STALLED_M)


def _upright(state: RoverState) -> float:
    """Return the cosine of the body's tilt."""
    x, y, _, _ = state.quaternion
    return 1.0 - 2.0 * (x * x + y * y)
