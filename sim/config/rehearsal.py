"""Configuration of a rehearsal: settings that differ from run to run."""

from typing import Self

from pydantic import model_validator

from survey.core.config import Section


class DrawnSetting(Section):
    """A setting that every run of a rehearsal draws from a range, evenly.

    Examples
    --------
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
