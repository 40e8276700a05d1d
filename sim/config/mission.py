"""Configuration of a mission: every section with defaults and units; unknown keys are refused.

A `PlacedSection` is a file of settings whose relative paths count from its folder. `DrawnSetting` is a range from which
every run of a rehearsal draws one setting. `MismatchConfig` draws ratios of assumed to simulated errors, uniform in the
logarithm. `MissionConfig` is the file; terrain, rover and instruments have their sections in the other modules of this
folder.
"""

from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PrivateAttr, model_validator

from planners.registry import PlannerConfig
from sim.config.rover import FleetConfig, PayloadConfig, PhysicsConfig, RoverConfig
from sim.config.sensors import FaultConfig, InstrumentsConfig, LidarConfig
from sim.config.world import (
    AppearanceConfig,
    DemTerrain,
    IceConfig,
    ImagingConfig,
    SatelliteConfig,
    SceneryConfig,
    TerrainConfig,
)
from survey.core import Section, stream
from survey.reconstruction.registry import ReconstructionConfig
from vision_slam import LocalizationConfig


class PlacedSection(Section):
    """Settings of a file; paths in it count from its folder."""

    _folder: Path = PrivateAttr(default=Path())

    def read_from(self, folder: Path) -> Self:
        """Return the settings with their relative paths counted from `folder`.

        Parameters
        ----------
        folder : pathlib.Path
            Folder of the file that was read.

        Returns
        -------
        PlacedSection
            The same settings.
        """
        placed = self.model_copy()
        placed._folder = folder
        return placed

    def path(self, file: str) -> Path:
        """Return the place of a file that the settings name.

        Parameters
        ----------
        file : str
            Path as the settings name it.

        Returns
        -------
        pathlib.Path
            Relative paths count from the folder of the file that was read.
        """
        return self._folder / file


class DrawnSetting(Section):
    """A setting that every run of a rehearsal draws from a range, evenly.

    >>> DrawnSetting(setting="sensors.gps_bias_sigma_m", between=(0.5, 2.0)).setting
    'sensors.gps_bias_sigma_m'
    """

    setting: str
    """Name of the setting with its section, such as sensors.gps_bias_sigma_m."""
    between: tuple[float, float]
    """Least and greatest value."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        low, high = self.between
        if low > high:
            raise ValueError(f"{self.setting} is drawn from {low:g} to {high:g}; put the smaller value first")
        return self


_SIGMAS = (
    "yaw_sigma_deg", "tilt_sigma_deg", "scale_sigma", "step_sigma_m", "gps_bias_sigma_m",
    "gps_white_sigma_m", "barometer_drift_sigma_m", "barometer_white_sigma_m",
)  # fmt: skip
_CORRELATIONS = ("gps_correlation_time_s", "barometer_correlation_time_s", "attitude_correlation_m")


class MismatchConfig(Section):
    """Ranges of the ratios of assumed to drawn errors; each ratio is drawn from its range, uniform in the logarithm."""

    sigma_ratio: tuple[PositiveFloat, PositiveFloat] = (1.0, 1.0)
    """Least and greatest ratio of an assumed standard deviation to the one that ``localization`` states."""
    landmark_ratio: tuple[PositiveFloat, PositiveFloat] = (1.0, 1.0)
    """The same of the claimed to the drawn standard deviations of landmarks, statistical fidelity only."""
    correlation_ratio: tuple[PositiveFloat, PositiveFloat] = (1.0, 1.0)
    """The same for assumed correlation times and lengths."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for name in ("sigma_ratio", "landmark_ratio", "correlation_ratio"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(
                    f"{name} goes from {low:g} to {high:g}, not from the smaller ratio to the greater"
                )
        return self

    def drawn_landmark_ratio(self, seed: int) -> float:
        """Draw the ratio of claimed to drawn standard deviations of landmarks."""
        return _drawn_ratio(self.landmark_ratio, seed, "landmarks")

    def assumed(self, stated: LocalizationConfig, seed: int) -> LocalizationConfig:
        """Return the assumptions of the estimator, off by the drawn ratios.

        >>> wrong = MismatchConfig(sigma_ratio=(2.0, 2.0)).assumed(LocalizationConfig(), 1)
        >>> wrong.gps_bias_sigma_m, wrong.gps_correlation_time_s
        (2.0, 120.0)
        """
        ranges = dict.fromkeys(_SIGMAS, self.sigma_ratio) | dict.fromkeys(
            _CORRELATIONS, self.correlation_ratio
        )
        changed = {
            name: getattr(stated, name) * _drawn_ratio(between, seed, name)
            for name, between in ranges.items()
            if between != (1.0, 1.0)
        }
        return stated.model_copy(update=changed)


def _drawn_ratio(between: tuple[float, float], seed: int, name: str) -> float:
    """Draw a ratio, uniform in its logarithm."""
    low, high = np.log(between)
    return float(np.exp(stream(seed, "mismatch", name).uniform(low, high)))


SCHEMA_VERSION = 1
"""Version of the keys of mission and study files; it grows when a key changes its meaning."""


class AreaConfig(Section):
    """Area to survey; all of the terrain by default."""

    file: str | None = None
    """Polygon file; a relative path counts from the mission file."""
    select: tuple[str, ...] = ()
    """Which outlines of the file: names, or COLUMN=VALUE such as RGIId=RGI60-11.00897; * stands for any letters."""
    bounds_m: tuple[float, float, float, float] | None = None
    """Rectangle xmin, ymin, xmax, ymax in the terrain's CRS [m]."""
    clip_to_terrain: bool = False
    """Cut the area to where the terrain is known instead of refusing."""
    starts_m: tuple[tuple[float, float], ...] = ()
    """Where rovers begin: one start for all or one for each, in the terrain's CRS [m]; those of the file by default."""

    @model_validator(mode="after")
    def _one_of_two(self) -> "AreaConfig":
        if self.file is not None and self.bounds_m is not None:
            raise ValueError("area.file and area.bounds_m exclude one another, give one of them")
        if self.select and self.file is None:
            raise ValueError("area.select chooses outlines of area.file, name the file")
        return self


class SensorConfig(Section):
    """The errors that the statistical fidelity draws; angles are standard deviations.

    The defaults are an SBAS-class receiver, a weather-drifting barometer and visual
    odometry with gravity-tied tilt. What the estimator assumes stands in `localization`.
    """

    gps_bias_sigma_m: NonNegativeFloat = 1.0
    """Slowly varying horizontal GPS error [m]."""
    gps_correlation_time_s: PositiveFloat = 120.0
    """Its correlation time [s]."""
    gps_white_sigma_m: NonNegativeFloat = 0.5
    """Independent horizontal GPS error [m]."""
    gps_vertical_factor: PositiveFloat = 1.7
    """Vertical over horizontal GPS error."""
    barometer_drift_sigma_m: NonNegativeFloat = 1.0
    """Drift of the pressure altitude [m]."""
    barometer_correlation_time_s: PositiveFloat = 1800.0
    """Its correlation time [s]."""
    barometer_white_sigma_m: NonNegativeFloat = 0.15
    """Independent error of the pressure altitude [m]."""
    yaw_sigma_deg: NonNegativeFloat = 0.2
    """Heading error of the odometry [deg]."""
    heading_walk_deg_sqrt_m: NonNegativeFloat = 0.0
    """Random walk of that error per square root of a metre [deg]."""
    tilt_sigma_deg: NonNegativeFloat = 0.1
    """Roll and pitch error [deg]."""
    tilt_bias_sigma_deg: NonNegativeFloat = 0.0
    """Constant part of it [deg]."""
    attitude_correlation_m: PositiveFloat = 60.0
    """Travel over which they stay correlated [m]."""
    scale_sigma: NonNegativeFloat = 0.004
    """Relative error of the odometry's scale."""
    step_sigma_m: NonNegativeFloat = 0.006
    """Random error of the odometry per square root of a metre [m]."""
    sample_step_m: PositiveFloat = 10.0
    """Travel between the samples of the ideal sensor [m]."""
    landmarks_per_m: PositiveFloat = 2.0
    """Landmarks triangulated per metre of travel."""
    landmark_range_m: tuple[float, float] = (5.0, 25.0)
    """Nearest and farthest range at first sight [m]."""
    landmark_cross_sigma_m: tuple[float, float] = (0.05, 0.0025)
    """Error across the line of sight: constant [m] and per metre of range."""
    landmark_along_sigma_m: tuple[float, float] = (0.02, 0.002)
    """Error along the line of sight: constant [m] and per metre of range squared."""
    landmark_shared_sigma_m: NonNegativeFloat = 0.0
    """Error of height that all landmarks of five metres of travel share [m]."""
    landmark_far_bias_m: float = 0.0
    """Height by which landmarks from beyond 15 m lie too high, since crests are seen and troughs are not [m]; it
    grows from 0 at 10 m."""
    lidar: LidarConfig = LidarConfig()
    """LiDAR, whose scans take the place of the landmarks in the map."""


class AidsConfig(Section):
    """What the survey has beside GPS and odometry to find its absolute height and keep level."""

    start: Literal["surveyed", "unknown"] = "surveyed"
    """Whether the start, and the heading there, are known; if not, the first fix stands for it."""
    heading_sigma_deg: NonNegativeFloat = 1.0
    """Error of the heading at an unknown start [deg]."""
    barometer: bool = True
    """A barometer on the rover."""
    accelerometer: bool = False
    """An accelerometer whose gravity ties roll and pitch."""
    accelerometer_bias_m_s2: NonNegativeFloat = 0.05
    """Its bias on each axis, constant over the drive [m/s²]."""
    accelerometer_white_m_s2: NonNegativeFloat = 0.05
    """Jolts and noise of each reading, a mean over a second [m/s²]."""
    turn_at_start: bool = True
    """Whether the rover, where it has one, stands under two headings before it sets off, to estimate that bias."""
    stakes: NonNegativeInt = 0
    """Number of surveyed stakes, at the ends of swaths, seen in passing."""
    stake_sigma_m: PositiveFloat = 0.05
    """Error of a stake's surveyed position [m]."""
    base_station: bool = False
    """A second receiver at the start."""
    base_residual: float = Field(default=0.2, gt=0.0, le=1.0)
    """Share of the slowly varying GPS error that the two receivers do not have in common."""
    base_barometer: bool = False
    """A second barometer at the start."""
    base_barometer_residual: float = Field(default=0.3, gt=0.0, le=1.0)
    """Share of the drift that the two barometers do not have in common."""
    way_home: bool = False
    """Whether the route ends where it began."""
    recognition: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of the meetings of the way with itself at which the place is recognised."""
    wrong_closures: NonNegativeInt = 0
    """How many of those recognitions are wrong, by 6 m."""


class ScoreConfig(Section):
    """How the map is judged."""

    require: Literal["class-1", "class-2", "class-3"] = "class-3"
    """The map class that is wanted (at its widest contour interval)."""
    sample_step_m: PositiveFloat = 10.0
    """Cell of the grid of possible samples for science-centric coverage [m]."""


def _is_prior(terrain: TerrainConfig) -> bool:
    """Return whether the raster of a terrain is the prior."""
    return isinstance(terrain, DemTerrain) and terrain.role == "prior"


class MissionConfig(PlacedSection):
    """Configuration of a mission."""

    schema_version: Literal[1]
    """Version of the format of mission files."""
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    """Name of the mission and of its folder of runs."""
    seed: NonNegativeInt = 0
    """Everything random follows from it."""
    fidelity: Literal["ideal", "statistical", "vision"] = "statistical"
    """Depth of the simulation: a perfect sensor, sensors with drawn errors, or a rover that drives and looks."""
    terrain: TerrainConfig
    """True terrain: drawn, read from a raster, or the sample."""
    satellite: SatelliteConfig = SatelliteConfig()
    """Prior elevations."""
    area: AreaConfig = AreaConfig()
    """Area to be surveyed."""
    planner: PlannerConfig
    """Pattern of the route."""
    rover: RoverConfig = RoverConfig()
    """Vehicle and the heights of its instruments."""
    fleet: FleetConfig = FleetConfig()
    """Number of rovers, where they finish, and what happens when one is lost."""
    sensors: SensorConfig = SensorConfig()
    """Errors that the statistical fidelity draws."""
    aids: AidsConfig = AidsConfig()
    """Aiding sensors beside GPS and odometry."""
    ice: IceConfig | None = None
    """Ice that flows and melts during the drive; at rest when left out."""
    mismatch: MismatchConfig = MismatchConfig()
    """Ratios of the errors that the estimator assumes to those that are drawn."""
    scenery: SceneryConfig = SceneryConfig()
    """Objects of the rendered scene."""
    appearance: AppearanceConfig = AppearanceConfig()
    """Snow, light and sky of the rendered scene."""
    imaging: ImagingConfig = ImagingConfig()
    """Lens and image sensor of the camera."""
    physics: PhysicsConfig = PhysicsConfig()
    """Vehicle dynamics and steering of the vision fidelity."""
    instruments: InstrumentsConfig = InstrumentsConfig()
    """Instruments of the vision fidelity."""
    faults: tuple[FaultConfig, ...] = ()
    """What goes wrong on a drive in the vision fidelity: tables of component, failure, from_s, until_s, strength, rover,
    probability. Stopped tracks end a drive in every fidelity."""
    payload: tuple[PayloadConfig, ...] = ()
    """Science payload: tables of name, unit, rate_hz, noise_sd, lag_s, and of the field that is simulated."""
    localization: LocalizationConfig = LocalizationConfig()
    """Assumptions of the estimator about its sensors."""
    reconstruction: ReconstructionConfig = ReconstructionConfig()
    """Reconstruction of the terrain."""
    score: ScoreConfig = ScoreConfig()
    """Scoring of the map."""
    rehearsal: tuple[DrawnSetting, ...] = ()
    """What the runs of a rehearsal draw beside their seeds: tables of setting and between."""

    @model_validator(mode="after")
    def _sees_lines_of_sight(self) -> "MissionConfig":
        if self.fidelity == "ideal" and self.reconstruction.uses_sight_lines:
            raise ValueError(
                "the ideal fidelity samples the ground where it stands and has no lines of sight; set fidelity = "
                "'statistical', or leave out rays, reconstruction.field.rays and the method carving"
            )
        return self

    @model_validator(mode="after")
    def _scans_real_ground(self) -> "MissionConfig":
        if self.fidelity == "ideal" and self.sensors.lidar.beams:
            raise ValueError(
                "the ideal fidelity has one perfect sensor and no LiDAR; set fidelity = 'statistical' or 'vision', or "
                "leave out sensors.lidar"
            )
        return self

    @model_validator(mode="after")
    def _has_one_prior(self) -> "MissionConfig":
        if self.satellite.file is not None and _is_prior(self.terrain):
            raise ValueError(
                "terrain.role = 'prior' makes the terrain's raster the prior, and satellite.file names another one; set "
                "terrain.role = 'truth', or leave satellite.file out"
            )
        return self

    @model_validator(mode="after")
    def _moves_below_one_rover(self) -> "MissionConfig":
        if self.ice is not None and self.fleet.rovers > 1:
            raise ValueError(
                f"the fleet has {self.fleet.rovers} rovers and the ice moves, which is supported for one rover: each drive would "
                "have an epoch and a motion of its own; set fleet.rovers = 1, or leave out ice"
            )
        return self

    @model_validator(mode="after")
    def _measures_every_quantity_once(self) -> "MissionConfig":
        names = [quantity.name for quantity in self.payload]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"the payload measures {twice} twice; give every quantity a name of its own")
        return self

    @model_validator(mode="after")
    def _has_rovers_of_the_fleet(self) -> "MissionConfig":
        for fault in self.faults:
            if fault.rover is not None and fault.rover > self.fleet.rovers:
                raise ValueError(
                    f"a fault names rover {fault.rover}, and the fleet has {self.fleet.rovers}; give a number from 1 to "
                    f"{self.fleet.rovers}"
                )
        if self.fleet.on_loss == "replan" and self.rover.battery_j is not None:
            raise ValueError(
                "fleet.on_loss = 'replan' is for rovers without a battery limit; leave out rover.battery_j, or set "
                "fleet.on_loss = 'continue'"
            )
        return self

    @property
    def assumed(self) -> LocalizationConfig:
        """What the estimator assumes of its sensors: the ideal sensor is exact to a millimetre."""
        if self.fidelity == "ideal":
            return LocalizationConfig(gps_bias_sigma_m=1e-3, gps_white_sigma_m=1e-3, gps_vertical_factor=1.0)
        stated = self.localization.model_copy(update={"start": self.aids.start})
        return self.mismatch.assumed(stated, self.seed)

    _site_seed: int | None = PrivateAttr(default=None)

    @property
    def site_seed(self) -> int:
        """Seed of what all rovers share: fine relief, surface and weather."""
        return self.seed if self._site_seed is None else self._site_seed

    def of_rover(self, rover: int) -> "MissionConfig":
        """Return the mission as one rover of the fleet has it: its faults, and seeds of its own for its errors.

        Parameters
        ----------
        rover : int
            Counted from 0; the first rover has the seed of the mission.

        Returns
        -------
        MissionConfig
            With the `site_seed` of this mission.
        """
        faults = tuple(
            fault
            for k, fault in enumerate(self.faults)
            if fault.rover in (None, rover + 1) and self._affects(k, fault, rover)
        )
        own = self.seed if rover == 0 else int(stream(self.seed, "fleet", rover).integers(2**62))
        alone = self.model_copy(update={"seed": own, "faults": faults})
        alone._site_seed = self.site_seed
        return alone

    def _affects(self, number: int, fault: FaultConfig, rover: int) -> bool:
        """Return whether a fault is drawn to affect a rover."""
        drawn = stream(self.seed, "faults", "drawn", number, rover).random()
        return bool(drawn < fault.probability)

    @property
    def input_files(self) -> dict[str, Path]:
        """The files that the mission reads, by their name in it."""
        named = {
            "terrain.file": getattr(self.terrain, "file", None),
            "area.file": self.area.file,
            "satellite.file": self.satellite.file,
            "appearance.horizon": None if self.appearance.horizon == "terrain" else self.appearance.horizon,
        }
        if self.ice is not None:
            assumed = self.ice.assumed.velocity_files
            named |= {
                f"ice.velocity_files[{k}]": file for k, file in enumerate(self.ice.velocity_files or ())
            }
            named |= {f"ice.assumed.velocity_files[{k}]": file for k, file in enumerate(assumed or ())}
        return {key: self.path(file) for key, file in named.items() if file is not None}
