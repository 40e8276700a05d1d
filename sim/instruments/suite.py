"""All instruments of the rover together, read stretch by stretch of its motion."""

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sim.config.sensors import InstrumentsConfig
from sim.instruments.gps import GpsReceiver
from sim.instruments.sensors import (
    InertialUnit,
    MagneticCompass,
    PressureAltimeter,
    StakeSpotter,
    WeatherField,
    WeatherStation,
    WheelEncoders,
)
from sim.vehicle.motion import RoverMotion
from survey.core.arrays import FloatArray
from survey.data.camera import Image
from survey.data.sensors import GpsFixes, SensorTables, table_types


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Readings(SensorTables):
    """What the rover has sensed during a stretch of time; what brought no reading is None.

    The records are those of a `survey.data.recording.Recording`; `frame` is the image at the end
    of the stretch, with the time that the camera's clock shows.
    """

    gps: GpsFixes | None = None
    frame: tuple[float, Image] | None = None


_KINDS = {
    name: table_types()[name]
    for name in ("gps", "base", "barometer", "wheels", "inertial", "compass", "weather", "stake_sightings")
}


class Instruments:
    """Reads all instruments but the camera.

    Parameters
    ----------
    config : InstrumentsConfig
        Their errors.
    antenna_height_m : float
        Of the GPS antenna above the ground [m].
    start : (3,) ndarray
        Where the base station's antenna stands [m].
    stakes : (K, 3) ndarray
        Where stakes really stand [m].
    seed : int
        The mission's: equal seeds and motions give equal readings, in whatever stretches.
    """

    def __init__(
        self,
        config: InstrumentsConfig,
        antenna_height_m: float,
        start: FloatArray,
        stakes: FloatArray,
        seed: int,
    ) -> None:
        self._gps = GpsReceiver(config, antenna_height_m, seed)
        self._start = start
        field_ = WeatherField(config.weather, float(start[2]), seed)
        self.spotter = StakeSpotter(config.stakes, stakes, seed)
        self._others: dict[str, Any] = {
            "barometer": PressureAltimeter(config.barometer, seed),
            "wheels": WheelEncoders(config.wheels, seed),
            "inertial": InertialUnit(config.inertial, seed),
            "compass": MagneticCompass(config.compass, seed),
            "weather": WeatherStation(config.weather, field_, seed),
            "stake_sightings": self.spotter,
        }

    def read(self, motion: RoverMotion) -> Readings:
        """Return what is sensed up to the end of a stretch of motion that begins where the last one ended."""
        fixes, base = self._gps.sense(motion, self._start)
        others = {name: instrument.sense(motion) for name, instrument in self._others.items()}
        return Readings(gps=fixes, base=base, **others)


@dataclass
class Log:
    """Collects readings into whole records."""

    _parts: dict[str, list[Any]] = field(default_factory=lambda: {name: [] for name in _KINDS})

    def add(self, readings: Readings) -> None:
        """Keep the readings of one more stretch."""
        for name, parts in self._parts.items():
            part = getattr(readings, name)
            if part is not None:
                parts.append(part)

    def records(self) -> dict[str, Any]:
        """Return what a recording holds of it, by its names there."""
        return {name: _joined(_KINDS[name], parts) for name, parts in self._parts.items()}


def _joined(kind: Any, parts: list[Any]) -> Any:
    """Return records of one kind as one; None of too few."""
    if sum(len(part) for part in parts) < kind.LEAST:
        return None
    return kind(*(np.concatenate([getattr(part, name.name) for part in parts]) for name in fields(kind)))
