"""A kernel: Matérn with ν = 7/2."""

from tests.docs.recipes.recipe import Recipe

KERNEL = Recipe(
    "Add a kernel",
    1,
    inserted={
        "survey/reconstruction/gp/kernels.py": (
            (
                "@dataclass(frozen=True)\nclass Whittle",
                '@dataclass(frozen=True)\nclass Matern72(Matern):\n    """Matérn covariance with ν = 7/2."""\n\n'
                '    family: ClassVar = "matern-7/2"\n    error_growth: ClassVar = 7.0\n\n'
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
