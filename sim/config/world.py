"""Configuration of the simulated site: terrain, satellite DEM, moving ice, and scenery.

The terrain is drawn at random, read from a raster, or the sample; the satellite DEM is a coarse copy of it with errors.
`IceConfig` gives flow and melt, and `IceAssumptions` the prior that the estimator has of them. The sections of the scene
describe relief finer than the cells, the surface and its light, and lens and image sensor.
"""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from survey.core.config import Section, Share
from survey.data.ice_motion import IceMotion
from survey.reconstruction.motion.priors import uniform_motion
from survey.reconstruction.prior import ErrorScale, PriorErrors, ProductName, SatelliteErrors

TerrainFamily = Literal[
    "squared-exponential", "matern-3/2", "matern-5/2", "gaussian_hills", "cosine_surface", "diamond_square",
    "fractional_brownian", "slope_and_waves",
]  # fmt: skip


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
        """Return the errors that are drawn: those stated, and those of the class for the others."""
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


class IceAssumptions(Section):
    """Prior of the ice's motion, which localization and the map estimate."""

    velocity_m_per_day: tuple[float, float] = (0.0, 0.0)
    """Expected velocity to the east and to the north [m/day]."""
    velocity_sigma_m_per_day: NonNegativeFloat = 3.0
    """Its standard deviation on each axis [m/day]."""
    velocity_change_sigma_m_per_day_km: NonNegativeFloat = 0.0
    """Standard deviation of its change over a kilometre [m/day/km]; 0 for one velocity everywhere."""
    velocity_files: tuple[str, str, str, str] | None = None
    """Rasters of the velocity to the east and to the north and of their standard deviations [m/day], in the CRS of the
    survey, instead of one velocity; paths count from the mission file."""
    lowering_m_per_day: float = 0.0
    """Expected lowering of the surface [m/day]."""
    lowering_sigma_m_per_day: NonNegativeFloat = 0.05
    """Its standard deviation [m/day]."""

    @model_validator(mode="after")
    def _has_one_velocity(self) -> "IceAssumptions":
        stated = sorted(name for name in self.model_fields_set if name.startswith("velocity_"))
        if self.velocity_files is not None and len(stated) > 1:
            raise ValueError(
                f"velocity_files and {', '.join(n for n in stated if n != 'velocity_files')} exclude one another, give one of them"
            )
        return self

    def prior(self, epoch_s: float, origin_m: tuple[float, float]) -> IceMotion:
        """Return the prior of one velocity at an epoch; `sim.world.moving_ice` reads rasters, too.

        `origin_m` (float, float): place that changes of velocity count from [m].
        """
        return uniform_motion(
            self.velocity_m_per_day,
            self.lowering_m_per_day,
            velocity_sigma=self.velocity_sigma_m_per_day,
            lowering_sigma=self.lowering_sigma_m_per_day,
            epoch_s=epoch_s,
            origin_m=origin_m,
            velocity_change_sigma=self.velocity_change_sigma_m_per_day_km,
        )


class IceConfig(Section):
    """Ice that flows and melts while it is surveyed; the terrain of the mission is that of the start of the drive."""

    velocity_m_per_day: NonNegativeFloat = 0.0
    """Velocity of the surface on the centre line [m/day]."""
    direction_deg: float = 0.0
    """Direction of the flow, counter-clockwise from east [deg]."""
    flow: Literal["uniform", "valley"] = "uniform"
    """One velocity everywhere, or that of a valley glacier, which is slower towards its margins."""
    half_width_m: PositiveFloat = 1000.0
    """Distance of the margins of a valley glacier from its centre line, which runs through the middle of the area [m]."""
    margin_share: float = Field(default=0.2, ge=0.0, le=1.0)
    """Velocity at the margins over that on the centre line: the share by which the ice slides."""
    flow_exponent: PositiveFloat = 3.0
    """Exponent n of Glen's flow law."""
    velocity_files: tuple[str, str] | None = None
    """Rasters of the velocity to the east and to the north [m/day], instead of the flow."""
    melt_m_per_day: NonNegativeFloat = 0.0
    """Lowering of the surface, as a mean over a day [m/day]."""
    diurnal_share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Amplitude of the daily cycle of melt over its mean; it is greatest at 14 h."""
    start_hour: float = Field(default=8.0, ge=0.0, lt=24.0)
    """Time of day when the drive begins [h]."""
    pose_interval_s: PositiveFloat = 1.0
    """Time between poses and readings of the statistical fidelity [s]; longer for slow drives of many hours."""
    stake_surveys: NonNegativeInt = 0
    """Number of times that every stake is surveyed, evenly from the start of the drive to its end."""
    swath_order: Literal["adjacent", "alternate"] = "adjacent"
    """Whether neighbouring swaths follow one another, or every second one is driven first and the others on the way back."""
    epoch_s: float | None = None
    """Time after the start of the drive of which the map is made and judged [s]; the middle of the drive by default."""
    assumed: IceAssumptions = IceAssumptions()
    """Prior of the estimate."""

    @model_validator(mode="after")
    def _has_one_flow(self) -> "IceConfig":
        if self.velocity_files is not None and self.velocity_m_per_day > 0.0:
            raise ValueError(
                "ice.velocity_files and ice.velocity_m_per_day exclude one another, give one of them"
            )
        return self


LARGEST_STEP_M = 0.25
"""Widest distance between the nodes of fine ground that rover and camera can be simulated on [m]."""


class SceneryConfig(Section):
    """Relief finer than the terrain's cells, and what a rover had better avoid; counts are per hectare."""

    step_m: Annotated[float, Field(gt=0.0, le=LARGEST_STEP_M)] = 0.25
    """Widest distance between the nodes of the fine terrain [m]."""
    surface: Literal["snow", "bare ice", "debris"] = "snow"
    """Surface of the glacier: snow, bare and dirty ice with melt channels, or ice that boulders and stones cover."""
    snow_cover: Share = 0.0
    """Share of bare ice or debris that lies under patches of snow."""
    boulders_per_ha: NonNegativeFloat = 30.0
    """Boulders more than 1 m wide on debris."""
    wind_from_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 235.0
    """Where the wind comes from that shaped the snow, clockwise from north [deg]."""
    dune_sd_m: NonNegativeFloat = 0.10
    """Standard deviation of snow dunes, 3 to 25 m long [m]."""
    sastrugi_sd_m: NonNegativeFloat = 0.03
    """Standard deviation of sastrugi, 1 to 4 m long [m]."""
    hummock_sd_m: NonNegativeFloat = 0.04
    """Standard deviation of ice hummocks, 2 to 12 m wide, without direction [m]."""
    crevasses_per_ha: NonNegativeFloat = 0.15
    """Crevasses, open and bridged."""
    bridged_share: Share = 0.4
    """Share of the crevasses that snow has bridged."""
    crevasse_depth_m: PositiveFloat = 4.5
    """Depth of open crevasses [m]."""
    pools_per_ha: NonNegativeFloat = 0.35
    """Melt pools."""
    channels_per_ha: NonNegativeFloat = 0.12
    """Melt channels."""
    dirt_cones_per_ha: NonNegativeFloat = 1.0
    """Dirt cones, 0.3 to 1 m high."""


class AppearanceConfig(Section):
    """Sun, air and the look of the surface."""

    sun_elevation_deg: Annotated[float, Field(gt=2.0, le=90.0)] = 25.0
    """Height of the sun above the horizon [deg]."""
    sun_from_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 220.0
    """Direction of the sun, clockwise from north [deg]."""
    sky_share: Share = 0.45
    """Share of the light on flat ground that comes from the sky; 1 is overcast."""
    haze_m: PositiveFloat = 3000.0
    """Distance at which haze leaves 1/e of the contrast [m]."""
    contrast: NonNegativeFloat = 1.0
    """Factor on the surface's fine texture; 1 is strongly wind-worked snow (3 to 4 % local contrast)."""
    debris: NonNegativeFloat = 1.0
    """Dark specks and stones, 6 per square metre at 1."""
    patches: NonNegativeFloat = 1.0
    """Strength of the grey patches of old snow, 4 to 120 m wide."""
    stones: Share = 0.0
    """Share of the ice that stones cover: 0 is snow, 1 a debris-covered tongue."""
    ridges_deg: NonNegativeFloat = 5.0
    """Mean height of the mountains around above the horizon; 0 hides them [deg]."""
    ridges_distance_m: PositiveFloat = 8000.0
    """Distance of those mountains [m]."""
    horizon: str | None = None
    """Raster of the ground that is seen around the site, instead of those mountains: a file, or terrain for that of the
    mission's terrain; a relative path counts from the mission file."""
    clouds: Share = 0.0
    """Share of the sky that clouds cover; they and their shadows drift with the wind. 0 for none."""
    cloud_speed_m_s: NonNegativeFloat = 8.0
    """Speed of the clouds, in the direction of the wind that shaped the snow [m/s]."""
    ruts: bool = False
    """Whether the rover's tracks leave ruts on the ground, which are seen where it turns or returns."""


class ImagingConfig(Section):
    """The rover's camera: a wide-angle fisheye that looks ahead and down, and its sensor."""

    width: PositiveInt = 640
    """Columns [pixels]."""
    height: PositiveInt = 480
    """Rows [pixels]."""
    field_of_view_deg: Annotated[float, Field(gt=10.0, lt=175.0)] = 100.0
    """Angle across the image's width [deg]."""
    distortion: tuple[float, float, float, float] = (-0.02, 0.004, 0.0, 0.0)
    """k1 to k4 of OpenCV's fisheye model."""
    height_m: PositiveFloat = 0.7
    """Height above the ground between the tracks [m]."""
    forward_m: float = 0.2
    """Distance ahead of the body's origin [m]."""
    pitch_down_deg: Annotated[float, Field(ge=-45.0, le=80.0)] = 15.0
    """Angle of the optical axis below the body's x axis [deg]."""
    row_readout_s: NonNegativeFloat = 0.0
    """Rolling shutter: time between neighbouring rows [s]."""
    exposure_s: NonNegativeFloat = 0.0
    """Time during which motion blurs a frame; 0 for none [s]."""
    gain: PositiveFloat | None = None
    """Grey levels per unit of radiance; automatic when not given."""
    brightness: Annotated[float, Field(gt=0.0, le=250.0)] = 200.0
    """Grey level that automatic gain gives to the 90th percentile."""
    gain_step_ev: NonNegativeFloat = 0.0
    """Steps in which automatic gain changes, in powers of two (exposure values); 0 for any gain."""
    vignetting: Share = 0.15
    """Loss of light in the corners."""
    drops: NonNegativeInt = 0
    """Drops of melt water on the lens, out of focus."""
    blur_px: NonNegativeFloat = 0.5
    """Standard deviation of the lens's blur [pixels]."""
    noise: Literal["on", "off"] = "on"
    """Whether the sensor adds shot and read noise."""
    read_noise: NonNegativeFloat = 0.6
    """Standard deviation of the read noise [grey levels]."""
    shot_noise: NonNegativeFloat = 0.085
    """Standard deviation of the shot noise per square root of a grey level."""
    colour: bool = False
    """Whether images have three channels, blue, green and red; grey otherwise."""
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] | None = None
    """Quality at which JPEG compresses the images, 1 to 100; not compressed when not given."""
