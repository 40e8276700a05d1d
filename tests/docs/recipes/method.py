"""A reconstruction method with settings: a level plane."""

from tests.docs.recipes.recipe import Recipe

METHOD = Recipe(
    "Add a reconstruction method",
    2,
    added={
        "survey/reconstruction/methods/level.py": '''"""Level plane at the mean of the heights (level)."""

import numpy as np
from pydantic import PositiveFloat

from survey.core.config import Section
from survey.data.dem import Dem
from survey.reconstruction.terrain_map import INTERPOLATED, Reconstruction
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
