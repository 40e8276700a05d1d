"""Registry of the simulated sensors: one entry for each table of a recording that the simulator fills.

To add a sensor: declare its record type and table in `survey.data.sensors`, its settings in
`sim.config.sensors`, its model in a module of this folder, and its entry here.
"""

from sim.instruments.barometer import PressureAltimeter, draw_barometer, draw_base_barometer
from sim.instruments.compass import MagneticCompass
from sim.instruments.gps import BaseReceiver, GpsReceiver, draw_base_fixes, draw_fixes
from sim.instruments.gps_faults import GpsFaults
from sim.instruments.inertial import InertialUnit, draw_inertial
from sim.instruments.lidar.drawn_scans import draw_lidar
from sim.instruments.sensor import Sensor
from sim.instruments.stakes import StakeSpotter, draw_stake_sightings, draw_stake_surveys, draw_stakes
from sim.instruments.visual_odometry import draw_loop_closures, draw_odometry, draw_sightings
from sim.instruments.weather import WeatherField, WeatherStation
from sim.instruments.wheels import WheelEncoders, WheelFaults

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
        "wheels",
        instrument=lambda setup: WheelEncoders(setup.config.wheels, setup.seed),
        faults=WheelFaults,
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
