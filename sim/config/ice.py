"""Configuration of moving ice: its flow and melt, and what the estimator assumes of them."""

from typing import Literal

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, model_validator

from survey.core.config import Section
from survey.data.ice.motion import IceMotion
from survey.reconstruction.motion.priors import uniform_motion


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
        """Return the prior of one velocity at an epoch; `sim.world.assumed_motion` reads rasters, too.

        Parameters
        ----------
        epoch_s : float
            Epoch in seconds of the recording.
        origin_m : (float, float)
            Place that changes of velocity count from [m].

        Returns
        -------
        IceMotion
            Prior of localization.
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
