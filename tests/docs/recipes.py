"""The recipes of CONTRIBUTING.md, each followed once: the files that an extension adds, and the lines it inserts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Recipe:
    """An extension of the packages, and a script that passes with it.

    Parameters
    ----------
    heading : str
        Heading in CONTRIBUTING.md.
    most_files : int
        Most files that the extension may touch.
    added : mapping of str to str
        Text of new files.
    inserted : mapping of str to sequence of pairs
        For each changed file, lines that exist and what is inserted before each of them.
    check : str
        Python that uses the extension.
    """

    heading: str
    most_files: int
    check: str
    added: Mapping[str, str] = field(default_factory=dict)
    inserted: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)

    def follow(self, root: Path) -> None:
        """Change the packages below a folder."""
        for name, text in self.added.items():
            (root / name).write_text(text, encoding="utf-8")
        for name, insertions in self.inserted.items():
            text = (root / name).read_text(encoding="utf-8")
            for anchor, new in insertions:
                assert text.count(anchor) == 1, f"{name}: {anchor!r}"
                text = text.replace(anchor, new + anchor)
            (root / name).write_text(text, encoding="utf-8")


PLANNER = Recipe(
    "Add a planner",
    2,
    added={
        "planners/patterns/diagonal.py": '''"""Diagonal: swaths at 45 degrees."""

from typing import Literal

from planners.config import SwathConfig
from planners.layout import straight_route
from planners.patterns.planner import LayoutTask, Planner
from survey.data.route import Route


class DiagonalConfig(SwathConfig):
    """Straight swaths at 45 degrees."""

    pattern: Literal["diagonal"] = "diagonal"
    """Name of the pattern."""


def _layout(config: DiagonalConfig, task: LayoutTask) -> Route:
    return straight_route(task.area, config.model_copy(update={"heading_deg": 45.0}), crew=task.crew)


DIAGONAL = Planner(DiagonalConfig, _layout)
'''
    },
    inserted={
        "planners/registry.py": (
            (
                "from planners.patterns.lawnmower import",
                "from planners.patterns.diagonal import DIAGONAL\n",
            ),
            ("    LAWNMOWER,\n    WAVY,", "    DIAGONAL,\n"),
        )
    },
    check="""
from firnline import SurveyArea, plan
from planners.registry import planner_config
area = SurveyArea.rectangle((500_000.0, 6_700_000.0, 500_200.0, 6_700_200.0), "EPSG:32608")
config = planner_config({"pattern": "diagonal", "swaths": 3}, "here")
assert plan(area, None, config).pattern == "diagonal"
area.write("site.gpkg")
command("plan", "site.gpkg", "--pattern", "diagonal", "--swaths", "3", "-o", "route.gpkg")
assert mission(planner={"pattern": "diagonal", "swaths": 2}).planner.swaths == 2
""",
)

METHOD = Recipe(
    "Add a reconstruction method",
    2,
    added={
        "survey/reconstruction/methods/level.py": '''"""Level plane at the mean of the heights (level)."""

import numpy as np
from pydantic import PositiveFloat

from survey.core.config import Section
from survey.data.dem import Dem
from survey.reconstruction.base import INTERPOLATED, Reconstruction
from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod


class LevelConfig(Section):
    """Settings of the level plane."""

    sigma_m: PositiveFloat = 5.0
    """Standard deviation of the terrain [m]."""


def _run(task: MappingTask) -> MappedTerrain:
    shape = task.grid.shape
    mean = Dem.on(task.grid, np.full(shape, task.points.z.mean()))
    std = Dem.on(task.grid, np.full(shape, task.config(LevelConfig).sigma_m))
    return MappedTerrain(Reconstruction(mean, std, np.full(shape, INTERPOLATED), "level", {}))


LEVEL = ReconstructionMethod("level", "a level plane", _run, {"level": LevelConfig}, uses_prior=False)
'''
    },
    inserted={
        "survey/reconstruction/registry.py": (
            (
                "from survey.reconstruction.methods.triangulation import",
                "from survey.reconstruction.methods.level import LEVEL, LevelConfig\n",
            ),
            ("GP, JOINT, DENSE", "LEVEL, "),
            (
                "    @property\n    def uses_sight_lines",
                '    level: LevelConfig = LevelConfig()\n    """Settings of the level plane."""\n\n',
            ),
        )
    },
    check="""
import numpy as np
from firnline import Grid, SurfacePoints, reconstruct
xyz = np.random.default_rng(1).uniform(0.0, 50.0, (40, 3)) + [500_000.0, 6_700_000.0, 100.0]
points = SurfacePoints(xyz, sigma_m=0.1, crs="EPSG:32608")
grid = Grid((500_000.0, 6_700_000.0, 500_050.0, 6_700_050.0), 5.0, "EPSG:32608")
assert reconstruct(points, grid, method="level").method == "level"
points.write("points.csv")
command("reconstruct", "points.csv", "--crs", "EPSG:32608", "--method", "level", "--set", "reconstruction.level.sigma_m=2", "-o", "map.tif")
assert mission(reconstruction={"method": "level", "level": {"sigma_m": 3.0}}).reconstruction.level.sigma_m == 3.0
""",
)

SENSOR = Recipe(
    "Add a sensor",
    4,
    added={
        "sim/instruments/inclinometer.py": '''"""Inclinometer: pitch of the rover with white noise, and its failure."""

from collections.abc import Sequence

import numpy as np

from sim.config.faults import FaultConfig, faults_of
from sim.config.sensors import InclinometerConfig
from sim.instruments.errors import Clock
from sim.instruments.sensor import StatisticalDrive, without_carried
from sim.vehicle.motion import RoverMotion
from survey.core.streams import stream
from survey.data.sensors.tables import Inclinometer


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
        "survey/data/sensors/tables.py": (
            (
                "\n\n@dataclass(frozen=True, eq=False, repr=False, kw_only=True)\nclass SensorTables",
                "\n\n@dataclass(frozen=True, eq=False, repr=False)\nclass Inclinometer(SensorRecords):\n"
                '    """Pitch of the rover [rad]."""\n\n    WHAT: ClassVar = "inclinometer readings"\n\n'
                "    pitch_rad: FloatArray\n",
            ),
            (
                "from typing import Any, get_args",
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
                "from sim.instruments.inertial import",
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
from sim.config.faults import FaultConfig
from sim.config.sensors import InstrumentsConfig
from sim.instruments.sensor import InstrumentSetup
from sim.instruments.suite import Instruments, ReadingLog
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

ROUTE_FORMAT = Recipe(
    "Add a route format",
    2,
    inserted={
        "survey/interchange/route_writers.py": (
            (
                "def _write_text(",
                "def _write_poly(route: Route, path: Path, _: Surroundings) -> None:\n"
                '    _write_text(path, "\\n".join("".join(f"{x:.4f} {y:.4f}\\n" for x, y in leg.xy) for leg in route.legs))\n\n\n',
            ),
            ('    ".waypoints": write_wpl', '    ".poly": _write_poly,\n'),
        ),
        "survey/interchange/route_readers.py": (
            (
                "def _read_qgc_plan",
                "def _read_poly(path: Path, _: CRS) -> list[Leg]:\n"
                '    parts = path.read_text(encoding="utf-8").strip().split("\\n\\n")\n'
                '    return _joined([Leg("swath", np.array([line.split() for line in part.splitlines()], float)) for part in parts])\n\n\n',
            ),
            ('    ".waypoints": _read_wpl', '    ".poly": _read_poly,\n'),
            ('".wkt")\n', '".poly", '),
        ),
    },
    check="""
from firnline import LawnmowerConfig, Route, SurveyArea, plan
area = SurveyArea.rectangle((500_000.0, 6_700_000.0, 500_200.0, 6_700_200.0), "EPSG:32608")
plan(area, None, LawnmowerConfig(swaths=3)).write("route.gpkg")
command("export", "route.gpkg", "out.poly")
command("export", "out.poly", "back.gpkg", "--crs", "EPSG:32608")
assert abs(Route.read("back.gpkg").ground_length_m - Route.read("route.gpkg").ground_length_m) < 0.01
""",
)

KERNEL = Recipe(
    "Add a kernel",
    1,
    inserted={
        "survey/reconstruction/gp/covariance/kernels.py": (
            (
                "@dataclass(frozen=True)\nclass Whittle",
                '@dataclass(frozen=True)\nclass Matern72(_Matern):\n    """Matérn covariance with ν = 7/2."""\n\n'
                '    family: ClassVar = "matern-7/2"\n    error_growth: ClassVar = 7.0\n    most_averaged: ClassVar = 5\n\n'
                '    @property\n    def smoothness(self) -> float:\n        """The smoothness ν."""\n        return 3.5\n\n'
                "    def _correlation(self, s2: FloatArray) -> FloatArray:\n        s = np.sqrt(7 * s2)\n"
                "        correlation: FloatArray = np.exp(-s) * (1 + s + 0.4 * s**2 + s**3 / 15)\n"
                "        return correlation\n\n\n",
            ),
            ("SquaredExponential, Matern52, Matern32,", "Matern72, "),
        )
    },
    check="""
import numpy as np
from firnline import GaussianProcessConfig, Grid, SurfacePoints, reconstruct
xyz = np.random.default_rng(1).uniform(0.0, 50.0, (40, 3)) + [500_000.0, 6_700_000.0, 100.0]
points = SurfacePoints(xyz, sigma_m=0.1, crs="EPSG:32608")
grid = Grid((500_000.0, 6_700_000.0, 500_050.0, 6_700_050.0), 5.0, "EPSG:32608")
config = GaussianProcessConfig(family="matern-7/2", fit=False, variance_m2=4.0, length_scale_m=20.0)
assert "matern-7/2" in str(reconstruct(points, grid, config=config).hyperparameters)
points.write("points.csv")
command("reconstruct", "points.csv", "--crs", "EPSG:32608", "--set", "reconstruction.gp.family=matern-7/2", "--set", "reconstruction.gp.fit=false",
        "--set", "reconstruction.gp.variance_m2=4", "--set", "reconstruction.gp.length_scale_m=20", "-o", "map.tif")
assert mission(reconstruction={"gp": {"family": "matern-7/2"}}).reconstruction.gp.family == "matern-7/2"
""",
)

RECIPES = (PLANNER, METHOD, SENSOR, ROUTE_FORMAT, KERNEL)
