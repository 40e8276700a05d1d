"""A sensor: an inclinometer that is drawn, simulated, written, read, and fails."""

from tests.docs.recipes.recipe import Recipe

SENSOR = Recipe(
    "Add a sensor",
    4,
    added={
        "sim/instruments/inclinometer.py": '''"""Inclinometer: pitch of the rover with white noise, and its failure."""

from collections.abc import Sequence

import numpy as np

from sim.config.sensors import FaultConfig, faults_of
from sim.config.sensors import InclinometerConfig
from sim.instruments.sensor import Clock
from sim.instruments.sensor import StatisticalDrive, without_carried
from sim.vehicle.motion import RoverMotion
from survey.core.streams import stream
from survey.data.recording import Inclinometer


class PitchSensor:
    """Inclinometer of the vision fidelity."""

    def __init__(self, config: InclinometerConfig, seed: int) -> None:
        self._sigma = np.radians(config.white_sigma_deg)
        self._clock = Clock(config, seed, "inclinometer")
        self._rng = stream(seed, "instruments", "inclinometer", "white")

    def sense(self, motion: RoverMotion) -> Inclinometer | None:
        """Return the pitch during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        pitch = motion.rotation_at(at_s).as_euler("ZYX")[:, 1]
        return Inclinometer(shown_s, pitch + self._sigma * self._rng.standard_normal(len(at_s)))


class InclinometerFaults:
    """Times without readings."""

    def __init__(self, faults: Sequence[FaultConfig], seed: int) -> None:
        del seed
        self._off = faults_of(faults, "inclinometer")

    def apply(self, records: Inclinometer) -> Inclinometer | None:
        """Return the readings outside the faults."""
        return without_carried(records, self._off)


def draw_inclinometer(drive: StatisticalDrive) -> Inclinometer:
    """Draw the readings of the statistical fidelity."""
    sigma = np.radians(drive.mission.instruments.inclinometer.white_sigma_deg)
    noise = stream(drive.mission.seed, "sensors", "inclinometer").standard_normal(len(drive.attitude_rad))
    return Inclinometer(drive.trajectory.time_s, drive.attitude_rad[:, 1] + sigma * noise)
'''
    },
    inserted={
        "survey/data/recording.py": (
            (
                "\n\n@dataclass(frozen=True, eq=False, repr=False, kw_only=True)\nclass SensorTables",
                "\n\n@dataclass(frozen=True, eq=False, repr=False)\nclass Inclinometer(SensorRecords):\n"
                '    """Pitch of the rover [rad]."""\n\n    WHAT: ClassVar = "inclinometer readings"\n\n'
                "    pitch_rad: FloatArray\n",
            ),
            (
                "from typing import Any, Self",
                "from typing import ClassVar\nfrom survey.core.arrays import FloatArray\n"
                "from survey.data.sensors.records import SensorRecords\n",
            ),
            ("    loop_closures: LoopClosures", "    inclinometer: Inclinometer | None = None\n"),
        ),
        "sim/config/sensors.py": (
            (
                "class InstrumentsConfig(Section)",
                'class InclinometerConfig(InstrumentConfig):\n    """Pitch."""\n\n'
                '    FAILURES: ClassVar[Mapping[str, float]] = MappingProxyType({"off": 0.0})\n'
                '    """It gives no readings."""\n'
                '    white_sigma_deg: NonNegativeFloat = 0.1\n    """Noise of a reading [deg]."""\n\n\n',
            ),
            (
                "\n\ndef sensor_failures",
                '    inclinometer: InclinometerConfig = InclinometerConfig()\n    """Inclinometer."""\n',
            ),
        ),
        "sim/instruments/registry.py": (
            (
                "from sim.instruments.dead_reckoning import",
                "from sim.instruments.inclinometer import InclinometerFaults, PitchSensor, draw_inclinometer\n",
            ),
            (
                '    Sensor("odometry"',
                '    Sensor("inclinometer", draw=draw_inclinometer, faults=InclinometerFaults,\n'
                "           instrument=lambda setup: PitchSensor(setup.config.inclinometer, setup.seed)),\n",
            ),
        ),
    },
    check="""
import numpy as np
from firnline import Grid, Recording, SurveyArea, plan, LawnmowerConfig, simulate
from survey.terrain import cosine_surface
from sim.config.sensors import FaultConfig
from sim.config.sensors import InstrumentsConfig
from sim.instruments.sensor import InstrumentSetup
from sim.instruments.registry import Instruments, ReadingLog
from sim.vehicle.motion import RoverMotion
terrain = cosine_surface(Grid((0.0, 0.0, 120.0, 120.0), 4.0, "EPSG:32608"), np.random.default_rng(0), relief_m=5.0)
area = SurveyArea.rectangle((20.0, 20.0, 100.0, 100.0), "EPSG:32608")
recording, _ = simulate(terrain, plan(area, None, LawnmowerConfig(swaths=2)))
recording.write("recording")
assert np.array_equal(Recording.read("recording").inclinometer.pitch_rad, recording.inclinometer.pitch_rad)
fault = FaultConfig(component="inclinometer", failure="off", from_s=3.0)
still = RoverMotion(np.linspace(0.0, 9.0, 10), np.zeros((10, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (10, 1)), *np.zeros((2, 10, 3)), np.zeros((10, 2)))
log = ReadingLog()
log.add(Instruments(InstrumentSetup(InstrumentsConfig(), 0.5, np.zeros(3), np.zeros((0, 3)), 1, 1), [fault]).read(still))
assert log.records()["inclinometer"].time_s.max() < 3.0
assert mission(instruments={"inclinometer": {"white_sigma_deg": 0.2}}).instruments.inclinometer.white_sigma_deg == 0.2
""",
)
