"""Configuration of the simulated sensors: rates, clocks, errors, and faults.

Each instrument has a section derived from `InstrumentConfig`, whose ``FAILURES`` name its failures and their usual
strengths. `FaultConfig` is one fault of a drive: component, failure, time interval and strength.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from survey.core.config import Section, Share


class InstrumentConfig(Section):
    """Settings common to all instruments: rate, clock offset, lost readings."""

    FAILURES: ClassVar[Mapping[str, float]] = MappingProxyType({})
    """Failures that a fault of this sensor may name, with their usual strengths; 0 where none is needed."""

    rate_hz: PositiveFloat = 1.0
    """Readings per second."""
    clock_offset_s: float = 0.0
    """What its clock shows too much [s]."""
    dropped_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    """Share of the readings that never arrive."""


class GpsConfig(InstrumentConfig):
    """A satellite receiver."""

    FAILURES: ClassVar[Mapping[str, float]] = MappingProxyType(
        {"off": 0.0, "frozen": 0.0, "jump": 15.0, "delayed": 2.0}
    )
    """Strengths: a jump [m], a delay [s]."""

    profile: Literal["white", "gauss-markov-60", "gauss-markov-300", "sbas", "rtk"] = "sbas"
    """Its error: 3 m without memory, 3 m with a memory of 60 or 300 s, 1 m with 120 s, or centimetres."""
    vertical_factor: PositiveFloat = 1.7
    """Vertical over horizontal error."""
    outages_per_h: NonNegativeFloat = 0.0
    """Times per hour that fixes are missing."""
    outage_s: PositiveFloat = 60.0
    """How long they are missing, in the mean [s]."""
    jumps_per_h: NonNegativeFloat = 0.0
    """Times per hour that the position jumps and stays away for a while, as when satellites change."""
    jump_m: NonNegativeFloat = 5.0
    """Standard deviation of a jump on each axis [m]."""
    multipath_per_h: NonNegativeFloat = 0.0
    """Times per hour that reflections disturb single fixes for some seconds."""
    multipath_m: NonNegativeFloat = 8.0
    """Standard deviation of a disturbed fix on each axis [m]."""


class WheelConfig(InstrumentConfig):
    """Encoders of both tracks; slip comes from the physics."""

    rate_hz: PositiveFloat = 20.0
    """Readings per second."""
    scale_error: float = 0.015
    """What both tracks count too much, as worn tracks do."""
    scale_difference: float = 0.002
    """What the left track counts more than the right one."""
    tick_m: PositiveFloat = 0.001
    """Smallest distance that is counted [m]."""


class InertialConfig(InstrumentConfig):
    """Gyro and accelerometer, of the kind that costs a few hundred dollars."""

    rate_hz: PositiveFloat = 80.0
    """Readings per second; the physics' rate has to be a multiple of it."""
    gyro_noise_deg_sqrt_h: NonNegativeFloat = 0.3
    """Angle random walk [deg/√h]."""
    gyro_bias_deg_h: NonNegativeFloat = 36.0
    """Standard deviation of the bias at the start [deg/h]."""
    gyro_bias_walk_deg_h_sqrt_h: NonNegativeFloat = 10.0
    """Random walk of the bias [deg/h/√h]."""
    force_noise_m_s2_sqrt_hz: NonNegativeFloat = 0.002
    """White noise of the specific force [m/s²/√Hz]."""
    force_bias_m_s2: NonNegativeFloat = 0.03
    """Standard deviation of its bias at the start [m/s²]."""
    force_bias_walk_m_s2_sqrt_h: NonNegativeFloat = 0.01
    """Random walk of its bias [m/s²/√h]."""


class BarometerConfig(InstrumentConfig):
    """Pressure, read as height."""

    drift_sigma_m: NonNegativeFloat = 1.0
    """Changes of the weather [m]."""
    correlation_time_s: PositiveFloat = 1800.0
    """Their correlation time [s]."""
    white_sigma_m: NonNegativeFloat = 0.15
    """Noise of a reading [m]."""


class CompassConfig(InstrumentConfig):
    """Magnetic heading: noise, and iron and currents that turn it by an amount that depends on the heading."""

    rate_hz: PositiveFloat = 5.0
    """Readings per second."""
    white_sigma_deg: NonNegativeFloat = 1.5
    """Noise of a reading [deg]."""
    hard_iron_deg: NonNegativeFloat = 5.0
    """Amplitude of the error with the period of one turn [deg]."""
    soft_iron_deg: NonNegativeFloat = 2.0
    """Amplitude of the error with the period of half a turn [deg]."""
    declination_error_deg: float = 0.5
    """What the assumed declination is wrong by [deg]."""


class WeatherConfig(InstrumentConfig):
    """The science payload: a thermometer and a hygrometer in fields that vary over the glacier."""

    temperature_c: float = -4.0
    """Mean temperature at the lowest ground [°C]."""
    lapse_c_per_km: float = 6.5
    """Fall of temperature with height [°C/km]."""
    temperature_sd_c: NonNegativeFloat = 0.8
    """Standard deviation of cold pools and warm spots, about 100 m wide [°C]."""
    humidity_percent: Annotated[float, Field(ge=0.0, le=100.0)] = 75.0
    """Mean relative humidity [%]."""
    humidity_sd_percent: NonNegativeFloat = 6.0
    """Standard deviation of its variation, about 100 m wide [%]."""
    temperature_noise_c: NonNegativeFloat = 0.1
    """Noise of the thermometer [°C]."""
    humidity_noise_percent: NonNegativeFloat = 1.5
    """Noise of the hygrometer [%]."""


class StakeConfig(Section):
    """Stakes of known position beside the way, recognised in passing."""

    count: NonNegativeInt = 0
    """How many stand evenly along the route."""
    beside_m: PositiveFloat = 3.0
    """Their distance from the route [m]."""
    survey_sigma_m: PositiveFloat = 0.05
    """Error of their known position on each axis [m]."""
    range_m: PositiveFloat = 8.0
    """Distance within which they are recognised [m]."""
    range_error_share: NonNegativeFloat = 0.02
    """Error along the line of sight per metre of range."""
    bearing_error_deg: NonNegativeFloat = 0.2
    """Error across the line of sight [deg]."""


class LidarConfig(InstrumentConfig):
    """A spinning LiDAR above the rover, 16 to 64 beams as a rule; it maps and does not steer."""

    beams: NonNegativeInt = Field(default=0, le=255)
    """Number of beams; 0 for no LiDAR."""
    rate_hz: PositiveFloat = 0.5
    """Turns that are recorded per second."""
    turn_s: PositiveFloat = 0.1
    """Duration of a turn [s]."""
    columns: int = Field(default=512, ge=16, le=65535)
    """Directions per turn."""
    elevation_deg: tuple[float, float] = (-18.0, 4.0)
    """Angles of the lowest and the highest beam above the level [deg]."""
    height_m: PositiveFloat = 1.5
    """Height of the scanner above the ground [m]."""
    range_m: PositiveFloat = 100.0
    """Farthest return [m]."""
    reach_m: PositiveFloat = 250.0
    """Range at which ground that faces the scanner still returns a pulse [m]; tilted ground returns it up to √cos of the
    angle of incidence times that range."""
    range_sigma_m: PositiveFloat = 0.03
    """Noise of a range [m]."""
    divergence_deg: NonNegativeFloat = 0.05
    """Standard deviation of the direction in which a pulse is returned, within its beam [deg]."""
    mounting_sigma_deg: NonNegativeFloat = 0.03
    """Error of the mounting about each axis, constant over the drive [deg]."""
    dropped_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.02
    """Share of the returns that never arrive."""
    ghost_share: Share = 0.002
    """Share of the returns with a wrong range, from anywhere along the beam."""
    spray_share: Share = 0.005
    """Share of the returns from blown snow near the scanner."""
    spray_m: PositiveFloat = 3.0
    """Mean distance of such snow [m]."""

    @model_validator(mode="after")
    def _looks_down_to_up(self) -> "LidarConfig":
        low, high = self.elevation_deg
        if not -90.0 <= low <= high <= 90.0:
            raise ValueError(
                f"elevation_deg is {low:g} to {high:g}; give the lowest and the highest beam, between -90 and 90"
            )
        return self


class InstrumentsConfig(Section):
    """Instruments of the vision fidelity."""

    frame_rate_hz: PositiveFloat = 4.0
    """Images per second; 4 at 1 m/s is one every 0.25 m."""
    gps: GpsConfig = GpsConfig()
    """GPS receiver."""
    base_station: bool = False
    """A second receiver of the same kind at the start, which shares most of the slow error."""
    base_residual: Share = 0.2
    """Share of the slow error that the two receivers do not have in common."""
    wheels: WheelConfig = WheelConfig()
    """Encoders of the tracks."""
    inertial: InertialConfig = InertialConfig()
    """Gyro and accelerometer."""
    barometer: BarometerConfig = BarometerConfig()
    """Barometer."""
    compass: CompassConfig = CompassConfig()
    """Magnetic compass."""
    weather: WeatherConfig = WeatherConfig()
    """Thermometer and hygrometer."""
    stakes: StakeConfig = StakeConfig()
    """Surveyed stakes along the route."""


def sensor_failures() -> dict[str, Mapping[str, float]]:
    """Return the failures of every instrument that has any, by its name in ``instruments``."""
    sections = {name: field.default for name, field in InstrumentsConfig.model_fields.items()}
    known = {name: s.FAILURES for name, s in sections.items() if isinstance(s, InstrumentConfig)}
    return {name: failures for name, failures in known.items() if failures}


FAILURES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "camera": {
            "whiteout": 235.0, "glare": 0.4, "dark": 0.04, "blur": 4.0, "frozen": 0.0, "dropped": 0.0,
            "lens-drop": 0.15,
        },
        **sensor_failures(),
        "tracks": {"stuck-left": 0.0, "stuck-right": 0.0, "slippery": 0.3, "stopped": 0.0},
        "rover": {"carried": 0.0},
        "start": {"kidnapped": 30.0},
        "calibration": {"focal-length": 0.005, "pitch": 0.5, "wheels": 0.03},
        "scenery": {"mountains-hidden": 0.0},
    }
)  # fmt: skip
"""Failures of every component, with their usual strengths.

Camera: grey level of a white-out, share of the image's width with glare, share of the light left
in the dark (above 1: overexposure), standard deviation of a blur [px], radius of a drop as a
share of the width. Tracks: share of speed left to a stuck track, friction left on slippery
ground; stopped tracks lose the rover, in every fidelity. Start: distance of a kidnapping [m]. Calibration: relative error of the focal length,
error of the camera's pitch [deg], relative error of the wheels. While the rover is carried all
instruments aboard are off. 0 where no strength is needed."""


class FaultConfig(Section):
    """A fault during an interval of time.

    Faults of start, calibration and scenery last for all of the drive.

    >>> FaultConfig(component="gps", failure="jump", from_s=60.0, until_s=90.0).size
    15.0
    """

    component: str
    """Component that fails; a key of `FAILURES`."""
    failure: str
    """Its failure; one of those that `FAILURES` lists for the component."""
    from_s: NonNegativeFloat = 0.0
    """Begin [s]."""
    until_s: PositiveFloat | None = None
    """End [s]; the end of the drive when left out."""
    strength: NonNegativeFloat | None = None
    """Strength; see `FAILURES` for its meaning and usual value."""
    rover: PositiveInt | None = None
    """Rover of the fleet that it affects, counted from 1; all of them when left out."""
    probability: Share = 1.0
    """Probability that it affects a rover; drawn from the mission's seed."""

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.component not in FAILURES:
            raise ValueError(
                f"the component {self.component!r} is not known; give one of {', '.join(FAILURES)}"
            )
        known = FAILURES[self.component]
        if self.failure not in known:
            raise ValueError(f"{self.component} has the failures {', '.join(known)}, not {self.failure!r}")
        if self.until_s is not None and self.until_s <= self.from_s:
            raise ValueError("a fault has to end after it begins")
        return self

    @property
    def size(self) -> float:
        """Strength as given, or the usual one."""
        return FAILURES[self.component][self.failure] if self.strength is None else self.strength

    def is_on(self, time_s: float) -> bool:
        """Return whether the fault acts at a time [s].

        `time_s`: time since the start [s].
        """
        return self.from_s <= time_s and (self.until_s is None or time_s < self.until_s)


def faults_of(faults: Sequence[FaultConfig], component: str) -> list[FaultConfig]:
    """Return the faults of one component, in their order."""
    return [fault for fault in faults if fault.component == component]
