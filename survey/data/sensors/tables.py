"""Names and types of the sensor tables of a recording."""

from dataclasses import dataclass, fields
from typing import Any, get_args, get_type_hints

from survey.core.data_object import DataObject
from survey.data.scans.lidar_scans import LidarScans
from survey.data.sensors.aiding import Barometer, Compass, GpsFixes, Inertial, Weather, Wheels
from survey.data.sensors.loop_closures import LoopClosures
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.sightings import Sightings
from survey.data.sensors.stakes import Stakes, StakeSightings, StakeSurveys


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SensorTables(DataObject):
    """Optional tables of a recording; None where a sensor gave no readings.

    A field declared here is a table of every recording: it is written to and read from a CSV
    file, or a folder (`table_file`), and the simulator collects its readings.
    """

    odometry: Odometry | None = None
    barometer: Barometer | None = None
    sightings: Sightings | None = None
    wheels: Wheels | None = None
    inertial: Inertial | None = None
    compass: Compass | None = None
    weather: Weather | None = None
    base: GpsFixes | None = None
    base_barometer: Barometer | None = None
    stakes: Stakes | None = None
    stake_surveys: StakeSurveys | None = None
    stake_sightings: StakeSightings | None = None
    loop_closures: LoopClosures | None = None
    lidar: LidarScans | None = None


def table_types() -> dict[str, Any]:
    """Return the record type of every table of a recording, by the table's name.

    Examples
    --------
    >>> table_types()["base"].__name__
    'GpsFixes'
    """
    hints = get_type_hints(SensorTables)
    optional = {field.name: get_args(hints[field.name])[0] for field in fields(SensorTables)}
    return {"gps": GpsFixes} | optional


def table_file(name: str) -> str:
    """Return the name of the file, or folder, of a table in a recording's folder.

    Examples
    --------
    >>> table_file("gps"), table_file("loop_closures")
    ('gps.csv', 'closures.csv')
    """
    return _FILE_NAMES.get(name, f"{name}.csv")


_FILE_NAMES = {"loop_closures": "closures.csv", "lidar": "lidar"}
