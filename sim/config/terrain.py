"""Configuration of the terrain of a mission, and of the satellite DEM of it."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from survey.core.config import Section
from survey.reconstruction.prior import ErrorScale, PriorErrors, ProductName, SatelliteErrors

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
    """The coarse elevations that are known before the survey: a raster, or cells made from the terrain.

    Cells that are made err independently unless a class of products is named, or one of its errors stated.

    Examples
    --------
    >>> SatelliteConfig(product="srtm-90", shift_sigma_m=0.0).errors().datum_sigma_m
    4.0
    """

    file: str | None = None
    """A raster of real elevations, of any resolution and CRS; a relative path counts from the mission file."""
    crs: str | None = None
    """For rasters that carry no CRS of their own."""
    vertical_datum: str | None = None
    """For rasters that do not state it."""
    cell_m: PositiveFloat = 75.0
    """Cell of the prior where it is made from fine terrain [m]."""
    product: ProductName = "unbiased"
    """Class of product whose errors are drawn: copernicus-30, srtm-90, aster-30, arcticdem-2, unknown, or unbiased
    (independent errors alone)."""
    sigma_m: NonNegativeFloat = 1.0
    """Standard deviation of its error, cell by cell [m]; that of the class where one is named and this left out."""
    correlated_sigma_m: NonNegativeFloat | None = None
    """Standard deviation of the error that neighbouring cells share [m]; of the class when left out."""
    correlation_m: PositiveFloat | None = None
    """Distance over which they share it [m]; of the class when left out."""
    datum_sigma_m: NonNegativeFloat | None = None
    """Standard deviation of the offset of its datum [m]; of the class when left out."""
    epoch_sigma_m: NonNegativeFloat | None = None
    """Standard deviation of the offset by melt and snow since its date [m]; of the class when left out."""
    tilt_sigma_m_per_km: NonNegativeFloat | None = None
    """Standard deviation of its tilt on either axis [m/km]; of the class when left out."""
    shift_sigma_m: NonNegativeFloat | None = None
    """Standard deviation of its horizontal displacement on either axis [m]; of the class when left out."""

    def errors(self) -> PriorErrors:
        """Return the errors that are drawn: those stated, and those of the class for the others.

        Returns
        -------
        PriorErrors
            Medians are the sizes themselves.
        """
        stated = SatelliteErrors(
            product=self.product,
            correlated_sigma_m=self.correlated_sigma_m,
            correlation_m=self.correlation_m,
            datum_sigma_m=self.datum_sigma_m,
            epoch_sigma_m=self.epoch_sigma_m,
            tilt_sigma_m_per_km=self.tilt_sigma_m_per_km,
            shift_sigma_m=self.shift_sigma_m,
        ).model()
        is_stated = self.product == "unbiased" or "sigma_m" in self.model_fields_set
        return stated._replace(white=ErrorScale(self.sigma_m)) if is_stated else stated
