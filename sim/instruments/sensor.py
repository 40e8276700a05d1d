"""Description of a simulated sensor: its instrument, its statistical model and its faults."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sim.config.faults import FaultConfig
from sim.config.mission import MissionConfig
from sim.config.sensors import InstrumentsConfig
from sim.vehicle.motion import RoverMotion
from sim.world.moving_ice import MovingIce
from survey.core.arrays import FloatArray
from survey.data.dem import Dem
from survey.data.route import Route
from survey.data.trajectory import Trajectory


class Instrument(Protocol):
    """Reads the real motion stretch by stretch; clocks and errors continue from call to call."""

    def sense(self, motion: RoverMotion, /) -> Any:
        """Return the records of a stretch of motion, or None without readings."""
        ...


class RecordFaults(Protocol):
    """Faults of one sensor, applied to its records stretch by stretch."""

    def apply(self, records: Any, /) -> Any:
        """Return the records with the faults in them, or None where none are left."""
        ...


@dataclass(frozen=True)
class InstrumentSetup:
    """Everything that the instruments of one drive are built from.

    Parameters
    ----------
    config : InstrumentsConfig
        Rates, clocks and errors.
    antenna_height_m : float
        Height of the GPS antenna above the ground [m].
    start : (3,) ndarray
        Place of the base station's antenna [m].
    stakes : (K, 3) ndarray
        Real places of the stakes [m].
    seed : int
        Seed of the rover's errors.
    site_seed : int
        Seed of what is the same for all rovers on the site.
    ice : MovingIce, optional
        Motion of the ice.
    """

    config: InstrumentsConfig
    antenna_height_m: float
    start: FloatArray
    stakes: FloatArray
    seed: int
    site_seed: int
    ice: MovingIce | None = None


@dataclass(frozen=True)
class StatisticalDrive:
    """A drive whose sensor records are drawn from error models.

    Parameters
    ----------
    terrain : Dem
        The real terrain.
    route : Route
        The route, which the rover follows exactly.
    trajectory : Trajectory
        Real poses, one a second.
    attitude_rad : (N, 3) ndarray
        Real roll, pitch and yaw [rad].
    mission : MissionConfig
        Errors of the sensors, and the seed.
    ice : MovingIce, optional
        Motion of the ice; the path is then that on the ice of the start of the drive, or the fixed one for sensors that
        measure in fixed coordinates.
    """

    terrain: Dem
    route: Route
    trajectory: Trajectory
    attitude_rad: FloatArray
    mission: MissionConfig
    ice: MovingIce | None = None


@dataclass(frozen=True)
class Sensor:
    """One sensor: everything that the simulator does with it.

    Parameters
    ----------
    name : str
        Name of its table in a recording, a field of `survey.data.sensors.SensorTables`.
    instrument : callable, optional
        Builds what reads the motion in the vision fidelity; gives None where the mission has no such sensor.
    draw : callable, optional
        Draws the table in the statistical fidelity; gives None where the mission has no such sensor.
    faults : callable, optional
        Builds the sensor's faults from all faults of a mission and its seed.
    is_aboard : bool
        Whether it is on the rover and therefore silent while the rover is carried.
    is_fixed : bool
        Whether it measures in fixed coordinates; others measure relative to the ice, which may move.
    """

    name: str
    instrument: Callable[[InstrumentSetup], Instrument | None] | None = None
    draw: Callable[[StatisticalDrive], Any] | None = None
    faults: Callable[[Sequence[FaultConfig], int], RecordFaults] | None = None
    is_aboard: bool = True
    is_fixed: bool = False


def without_carried(records: Any, carried: Sequence[FaultConfig]) -> Any:
    """Return the records outside the times that the rover is carried, or None where none are left."""
    if records is None or not carried:
        return records
    awake = np.array([not any(fault.is_on(t) for fault in carried) for t in records.time_s], dtype=bool)
    if not awake.any():
        return None
    return records.select(awake)
