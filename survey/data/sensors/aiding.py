"""Records of aiding sensors: GPS fixes, barometer, wheels, inertial unit, compass, weather."""

from dataclasses import dataclass
from typing import ClassVar

from survey.core.arrays import FloatArray
from survey.data.sensors.records import SensorRecords


@dataclass(frozen=True, eq=False, repr=False)
class GpsFixes(SensorRecords):
    """Positions from a satellite receiver: ``time_s`` (N,), ``position`` (N, 3) east, north, up [m].

    Times without a fix are simply not there.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    position : (N, 3) array_like
        Easting, northing and elevation of the antenna [m].
    sigma_m : (N,) array_like, optional
        Horizontal standard deviation of each fix as the receiver states it, in each axis [m]. Where
        it is missing, all fixes have the errors that the configuration of localization assumes.
    """

    COLUMNS: ClassVar = {"position": ("easting_m", "northing_m", "height_m")}
    WHAT: ClassVar = "GPS fixes"
    LEAST: ClassVar = 2

    position: FloatArray
    sigma_m: FloatArray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Barometer(SensorRecords):
    """Pressure altitude: ``time_s`` (N,), ``height_m`` (N,) above an unknown datum.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    height_m : (N,) array_like
        Pressure altitude above an unknown datum [m].
    """

    WHAT: ClassVar = "barometer readings"

    height_m: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Wheels(SensorRecords):
    """Encoders: ``time_s`` (N,), distance rolled by the left and the right track since the start [m].

    Slip is in it: a track that spins on the spot goes on counting.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    left_m : (N,) array_like
        Distance rolled by the left track since the start [m].
    right_m : (N,) array_like
        Distance rolled by the right track since the start [m].
    """

    WHAT: ClassVar = "encoder readings"

    left_m: FloatArray
    right_m: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Inertial(SensorRecords):
    """Gyro and accelerometer in the body frame.

    ``gyro_rad_s`` (N, 3) are the rates about x, y and z; ``specific_force_m_s2`` (N, 3)
    is what an accelerometer reads: +g along z when standing level.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    gyro_rad_s : (N, 3) array_like
        Angular rates in the body frame [rad/s].
    specific_force_m_s2 : (N, 3) array_like
        Specific force in the body frame [m/s²].
    """

    COLUMNS: ClassVar = {
        "gyro_rad_s": ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"),
        "specific_force_m_s2": ("force_x_m_s2", "force_y_m_s2", "force_z_m_s2"),
    }
    WHAT: ClassVar = "inertial readings"

    gyro_rad_s: FloatArray
    specific_force_m_s2: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Compass(SensorRecords):
    """Magnetic heading: ``heading_rad`` (N,), counter-clockwise from grid east, with its distortion.

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    heading_rad : (N,) array_like
        Magnetic heading [rad], counter-clockwise from grid east.
    """

    WHAT: ClassVar = "compass readings"

    heading_rad: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Weather(SensorRecords):
    """Science payload: ``temperature_c`` (N,) and relative ``humidity_percent`` (N,).

    Parameters
    ----------
    time_s : (N,) array_like
        Times, strictly increasing [s].
    temperature_c : (N,) array_like
        Air temperature [°C].
    humidity_percent : (N,) array_like
        Relative humidity [%].
    """

    WHAT: ClassVar = "weather readings"

    temperature_c: FloatArray
    humidity_percent: FloatArray
