"""Registry of the simulated sensors, and the suite that reads all of them.

`SENSORS` has one entry for each table of a recording that the simulator fills. `Instruments` reads every instrument
during a stretch of the drive and applies the faults; `ReadingLog` collects the readings. To add a sensor: declare its
record type and table in `survey.data.sensors`, its settings in `sim.config.sensors`, its model in a module of this
folder, and its entry here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sim.config.sensors import FaultConfig, faults_of
from sim.instruments.dead_reckoning import (
    InertialUnit,
    MagneticCompass,
    PressureAltimeter,
    WheelEncoders,
    WheelFaults,
    draw_barometer,
    draw_base_barometer,
    draw_inertial,
)
from sim.instruments.environment import WeatherField, WeatherStation
from sim.instruments.gps import BaseReceiver, GpsFaults, GpsReceiver, draw_base_fixes, draw_fixes
from sim.instruments.lidar import draw_lidar
from sim.instruments.sensor import Instrument, InstrumentSetup, Sensor, without_carried
from sim.instruments.visual_measurements import (
    StakeSpotter,
    draw_loop_closures,
    draw_odometry,
    draw_sightings,
    draw_stake_sightings,
    draw_stake_surveys,
    draw_stakes,
    survey_repeatedly,
    survey_stakes,
)
from sim.vehicle.motion import RoverMotion
from survey.data.recording import Readings, table_types

SENSORS = (
    Sensor(
        "gps",
        instrument=lambda setup: GpsReceiver(setup.config, setup.antenna_height_m, setup.seed),
        draw=draw_fixes,
        faults=GpsFaults,
        is_fixed=True,
    ),
    Sensor(
        "base",
        instrument=lambda setup: (
            BaseReceiver(setup.config, setup.start, setup.seed) if setup.config.base_station else None
        ),
        draw=draw_base_fixes,
        is_aboard=False,
        is_fixed=True,
    ),
    Sensor(
        "barometer",
        instrument=lambda setup: PressureAltimeter(setup.config.barometer, setup.seed),
        draw=draw_barometer,
        is_fixed=True,
    ),
    Sensor("base_barometer", draw=draw_base_barometer, is_aboard=False, is_fixed=True),
    Sensor(
        "wheels", instrument=lambda setup: WheelEncoders(setup.config.wheels, setup.seed), faults=WheelFaults
    ),
    Sensor(
        "inertial",
        instrument=lambda setup: InertialUnit(setup.config.inertial, setup.seed),
        draw=draw_inertial,
    ),
    Sensor("compass", instrument=lambda setup: MagneticCompass(setup.config.compass, setup.seed)),
    Sensor(
        "weather",
        instrument=lambda setup: WeatherStation(
            setup.config.weather,
            WeatherField(setup.config.weather, float(setup.start[2]), setup.site_seed),
            setup.seed,
        ),
    ),
    Sensor("stakes", draw=draw_stakes, is_aboard=False),
    Sensor("stake_surveys", draw=draw_stake_surveys, is_aboard=False),
    Sensor(
        "stake_sightings",
        instrument=lambda setup: StakeSpotter(setup.config.stakes, setup.stakes, setup.seed),
        draw=draw_stake_sightings,
    ),
    Sensor("odometry", draw=draw_odometry),
    Sensor("sightings", draw=draw_sightings),
    Sensor("loop_closures", draw=draw_loop_closures),
    Sensor("lidar", draw=draw_lidar),
)
"""All sensors; each draws from random streams of its own, so their order changes no reading."""


class Instruments:
    """All instruments of `SENSORS`; they read stretches of motion and leave out the camera.

    `setup`: errors, places and seed: equal setups and motions give equal readings, however the motion is cut
    into stretches. `faults`: faults of the mission; those of instruments are applied to the readings.
    """

    def __init__(self, setup: InstrumentSetup, faults: Sequence[FaultConfig] = ()) -> None:
        built = {sensor.name: sensor.instrument(setup) for sensor in SENSORS if sensor.instrument is not None}
        self._instruments: dict[str, Instrument] = {
            name: instrument for name, instrument in built.items() if instrument is not None
        }
        self._fixed = {sensor.name for sensor in SENSORS if sensor.is_fixed}
        self._faults, self._setup = SensorFaults(faults, setup.seed), setup

    def read(self, motion: RoverMotion) -> Readings:
        """Return what is sensed up to the end of a stretch of motion that begins where the last one ended.

        On moving ice the motion is that relative to the ice of the start of the drive.
        """
        ice = self._setup.ice
        fixed = motion if ice is None else motion.displaced(ice.displacement)
        records = {
            name: self._faults.apply(name, instrument.sense(fixed if name in self._fixed else motion))
            for name, instrument in self._instruments.items()
        }
        return Readings(**records)

    def stake_tables(self, end_s: float) -> dict[str, Any]:
        """Return the tables of surveyed stakes after a drive: once before it, and on moving ice repeatedly until its end."""
        setup, ice = self._setup, self._setup.ice
        feet, config = setup.stakes, setup.config.stakes
        tables: dict[str, Any] = {"stakes": survey_stakes(config, feet, setup.seed)}
        if ice is not None and ice.config.stake_surveys and len(feet):
            ends_s = np.array([0.0, end_s])
            tables["stake_surveys"] = survey_repeatedly(feet, ice, ends_s, config.survey_sigma_m, setup.seed)
        return tables


class SensorFaults:
    """Faults of all sensors, and their silence while the rover is carried.

    `faults`: faults of the mission; those of other components are ignored. `seed`: the mission's seed.
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
        joined = {name: _joined_readings(table_types()[name], parts) for name, parts in self._parts.items()}
        return {name: records for name, records in joined.items() if records is not None}


def _joined_readings(kind: Any, parts: list[Any]) -> Any:
    """Return records of one kind as one, or None of too few."""
    if sum(len(part) for part in parts) < kind.LEAST:
        return None
    names = [field.name for field in fields(kind) if getattr(parts[0], field.name) is not None]
    return kind(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
