r"""Settings of a season, with melt rates and densities of the literature.

- Melt: degree-day factors of ice are 5.4 to 20 mm w.e. °C⁻¹ d⁻¹ and of snow 2.5 to 11.6 (Hock 2003, Journal of Hydrology
  282, 104); 8 and 4.5 are taken, at a mean temperature of 5 °C in the season.
- Density: 850 ± 60 kg m⁻³ turns a change of volume into one of mass (Huss 2013, The Cryosphere 7, 877); bare ice that
  melts has 900 ± 20 kg m⁻³ (Cuffey and Paterson 2010, The Physics of Glaciers, Table 2.1).
- Flow: over a complete glacier, submergence and emergence cancel (continuity; Cuffey and Paterson 2010, section 8.5);
  over a part of one they do not, and `emergence_m_year` states how uncertain their mean is.
"""

from dataclasses import dataclass
from datetime import date
from typing import Literal, NamedTuple

import numpy as np

from planners.guarantee.posterior.surfaces import Surface
from survey.core.errors import ConfigError

Unit = Literal["m w.e.", "%"]

_MEAN_TEMPERATURE_C = 5.0


class SeasonSurface(NamedTuple):
    """Melt [m w.e. per °C and day], and density of what melts with its standard deviation [kg m⁻³]."""

    degree_day_m: float
    density_kg_m3: float
    density_std_kg_m3: float

    @property
    def melt_m_we_day(self) -> float:
        """Melt of a day at the mean temperature of the season [m w.e.]."""
        return self.degree_day_m * _MEAN_TEMPERATURE_C


SEASON_SURFACES: dict[Surface, SeasonSurface] = {
    "bare-ice": SeasonSurface(0.008, 900.0, 20.0),
    "snow": SeasonSurface(0.0045, 850.0, 60.0),
}
"""Surfaces of glaciers."""


@dataclass(frozen=True)
class SeasonConfig:
    """Settings of a season's design.

    Parameters
    ----------
    wanted : float
        Half the width of the 95 % interval of the mass balance [m w.e.] or of the change of volume [%].
    unit : {"m w.e.", "%"}
        Unit of `wanted`.
    first_day, last_day : datetime.date
        Days that the two surveys are about.
    surface : {"bare-ice", "snow"}
        Class of the ground.
    melt_m_we_day : float, optional
        Mean melt of a day [m w.e.]; that of the surface by default.
    emergence_m_year : float
        Standard deviation of the mean vertical motion of the ice over the area [m per year]; 0 for a complete
        glacier.
    noise_m, shared_m : float
        Standard deviation of a sample's height, and of an error that all samples of a survey share [m].
    sample_step_m : float
        Distance between samples [m].
    km_a_day : float
        Distance that is driven in a day [km].
    max_swaths : int, optional
        Most swaths to consider.

    Raises
    ------
    ConfigError
        A number out of its range, days in the wrong order, or a surface that is no glacier.
    """

    wanted: float
    unit: Unit
    first_day: date
    last_day: date
    surface: Surface = "bare-ice"
    melt_m_we_day: float | None = None
    emergence_m_year: float = 0.0
    noise_m: float = 0.1
    shared_m: float = 0.05
    sample_step_m: float = 10.0
    km_a_day: float = 10.0
    max_swaths: int | None = None

    def __post_init__(self) -> None:
        if self.surface not in SEASON_SURFACES:
            raise ConfigError(
                f"the surface of a season is {self.surface}; take {' or '.join(SEASON_SURFACES)}, the surfaces of glaciers."
            )
        if self.last_day <= self.first_day:
            raise ConfigError(
                f"the season ends on {self.last_day}, not after {self.first_day}; give a later day."
            )
        for name in ("wanted", "km_a_day"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be greater than 0.")
        for name in ("melt_m_we_day", "emergence_m_year"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value >= 0.0):
                raise ConfigError(f"{name} is {value}; it must be 0 or greater.")
        if self.unit == "%" and self.melt_m_we_day == 0.0:
            raise ConfigError("a change of 0 m has no error in percent; state the wanted error in m w.e.")

    @property
    def n_days(self) -> int:
        """Days between the surveys."""
        return (self.last_day - self.first_day).days

    @property
    def density_kg_m3(self) -> float:
        """Density of what melts [kg m⁻³]."""
        return SEASON_SURFACES[self.surface].density_kg_m3

    @property
    def melt_m_day(self) -> float:
        """Lowering of the surface in a day [m]."""
        stated = self.melt_m_we_day
        melt = SEASON_SURFACES[self.surface].melt_m_we_day if stated is None else stated
        return 1000.0 * melt / self.density_kg_m3

    @property
    def change_m(self) -> float:
        """Expected lowering of the surface between the surveys [m]."""
        return self.n_days * self.melt_m_day
