"""Configuration of the terrain of a mission, and of the satellite DEM of it."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from survey.core.config import Section

TerrainFamily = Literal[
    "squared-exponential",
    "matern-3/2",
    "matern-5/2",
    "gaussian_hills",
    "cosine_surface",
    "diamond_square",
    "fractional_brownian",
    "slope_and_waves",
]


class RandomTerrain(Section):
    """Terrain drawn at random."""

    source: Literal["random"]
    """Kind of terrain."""
    family: TerrainFamily = "squared-exponential"
    """Kind of random surface."""
    size_m: PositiveFloat = 600.0
    """Side of the square site [m]."""
    relief_m: PositiveFloat = 25.0
    """Highest minus lowest point before micro-relief [m]."""
    length_scale_m: PositiveFloat = 220.0
    """Correlation length, for the families that have one [m]."""
    micro_relief_sd_m: NonNegativeFloat = 0.0
    """Standard deviation of the ice micro-relief put on top [m]."""
    step_m: PositiveFloat = 1.0
    """Cell of the fine terrain [m]."""
    crs: str = "EPSG:32608"
    """Where the site is put; UTM zone 8N holds the Mendenhall Glacier."""
    origin_m: tuple[float, float] = (526000.0, 6478000.0)
    """South-west corner of the site, easting and northing [m]."""


class DemTerrain(Section):
    """Terrain from an elevation raster."""

    source: Literal["dem"]
    """Kind of terrain."""
    file: str
    """The raster; a relative path counts from the mission file."""
    role: Literal["truth", "prior"] = "truth"
    """Whether it is fine terrain to be surveyed, or coarse cells to which fine detail is added."""
    crs: str | None = None
    """For rasters that carry no CRS of their own."""
    vertical_datum: str | None = None
    """For rasters that do not state it."""
    micro_relief_sd_m: NonNegativeFloat = 0.0
    """Standard deviation of the ice micro-relief put on top [m]."""
    step_m: PositiveFloat = 1.0
    """Cell of the fine terrain where the raster is the prior [m]."""


class SampleTerrain(Section):
    """A site of 600 × 600 m in the real SRTM elevations that matplotlib installs."""

    source: Literal["srtm-sample"]
    """Kind of terrain."""
    micro_relief_sd_m: NonNegativeFloat = 0.35
    """Standard deviation of the ice micro-relief put on top [m]."""
    step_m: PositiveFloat = 1.0
    """Cell of the fine terrain [m]."""


TerrainConfig = Annotated[RandomTerrain | DemTerrain | SampleTerrain, Field(discriminator="source")]


class SatelliteConfig(Section):
    """The coarse elevations that are known before the survey."""

    cell_m: PositiveFloat = 75.0
    """Cell of the prior where it is made from fine terrain [m]."""
    sigma_m: NonNegativeFloat = 1.0
    """Standard deviation of its error, cell by cell [m]."""
