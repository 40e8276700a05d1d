"""All instruments of the simulated rover together: readings, faults of readings, and their collection."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sim.config.faults import FaultConfig, faults_of
from sim.instruments.registry import SENSORS
from sim.instruments.sensor import Instrument, InstrumentSetup, without_carried
from sim.vehicle.motion import RoverMotion
from survey.data.sensors.readings import Readings
from survey.data.sensors.tables import table_types


class Instruments:
    """All instruments of `SENSORS`; they read stretches of motion and leave out the camera.

    Parameters
    ----------
    setup : InstrumentSetup
        Errors, places and seed: equal setups and motions give equal readings, however the
        motion is cut into stretches.
    faults : sequence of FaultConfig
        Faults of the mission; those of instruments are applied to the readings.
    """

    def __init__(self, setup: InstrumentSetup, faults: Sequence[FaultConfig] = ()) -> None:
        built = {sensor.name: sensor.instrument(setup) for sensor in SENSORS if sensor.instrument is not None}
        self._instruments: dict[str, Instrument] = {
            name: instrument for name, instrument in built.items() if instrument is not None
        }
        self._fixed = {sensor.name for sensor in SENSORS if sensor.is_fixed}
        self._faults, self._ice = SensorFaults(faults, setup.seed), setup.ice

    def read(self, motion: RoverMotion) -> Readings:
        """Return what is sensed up to the end of a stretch of motion that begins where the last one ended.

        On moving ice the motion is that relative to the ice of the start of the drive.
        """
        fixed = motion if self._ice is None else motion.displaced(self._ice.displacement)
        records = {
            name: self._faults.apply(name, instrument.sense(fixed if name in self._fixed else motion))
            for name, instrument in self._instruments.items()
        }
        return Readings(**records)


class SensorFaults:
    """Faults of all sensors, and their silence while the rover is carried.

    Parameters
    ----------
    faults : sequence of FaultConfig
        Faults of the mission; those of other components are ignored.
    seed : int
        The mission's seed.
    """

    def __init__(self, faults: Sequence[FaultConfig], seed: int) -> None:
        self._carried = faults_of(faults, "rover")
        self._models = {
            sensor.name: sensor.faults(faults, seed) for sensor in SENSORS if sensor.faults is not None
        }
        self._aboard = {sensor.name for sensor in SENSORS if sensor.is_aboard}

    def apply(self, name: str, records: Any) -> Any:
        """Return records of a sensor with its faults, or None where none are left."""
        if records is not None and name in self._models:
            records = self._models[name].apply(records)
        return without_carried(records, self._carried) if name in self._aboard else records


@dataclass
class ReadingLog:
    """Collects the readings of stretches into the records of a drive."""

    _parts: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, readings: Readings) -> None:
        """Append the readings of one more stretch."""
        for sensor in SENSORS:
            part = getattr(readings, sensor.name)
            if part is not None:
                self._parts.setdefault(sensor.name, []).append(part)

    def records(self) -> dict[str, Any]:
        """Return the records by their names in a recording; too few of one kind are left out."""
        joined = {name: _joined(table_types()[name], parts) for name, parts in self._parts.items()}
        return {name: records for name, records in joined.items() if records is not None}


def _joined(kind: Any, parts: list[Any]) -> Any:
    """Return records of one kind as one, or None of too few."""
    if sum(len(part) for part in parts) < kind.LEAST:
        return None
    names = [field.name for field in fields(kind) if getattr(parts[0], field.name) is not None]
    return kind(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
