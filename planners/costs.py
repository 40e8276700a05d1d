"""Person-days and cost of a survey in the field, from rates in a settings file.

The survey takes whole days of driving; people and rovers are paid for each of them, and people for the days of travel
and set-up as well.
"""

import math
from pathlib import Path
from typing import NamedTuple, Self

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from survey.core.config import Section, read_toml, validated


class FieldWork(NamedTuple):
    """Days in the field, person-days with travel and set-up, and cost in a currency."""

    days: int
    person_days: float
    cost: float
    currency: str

    def __str__(self) -> str:
        plural = "" if self.days == 1 else "s"
        return f"{self.days} day{plural}, {self.person_days:g} person-days, {self.cost:.0f} {self.currency}"


class Rates(Section):
    """Rates of field work.

    Examples
    --------
    >>> rates = Rates(currency="EUR", people=2, person_day=600.0, rover_day=150.0, travel_days=1.0)
    >>> print(rates.field_work(time_s=10 * 3600.0, n_rovers=1))
    2 days, 6 person-days, 3900 EUR
    """

    currency: str = Field(min_length=1)
    """Currency of all rates, such as EUR."""
    person_day: NonNegativeFloat
    """Cost of one person for one day."""
    people: PositiveInt = 2
    """Number of people in the field."""
    hours_a_day: PositiveFloat = Field(default=8.0, le=24.0)
    """Hours of driving in a day [h]."""
    rover_day: NonNegativeFloat = 0.0
    """Cost of one rover for one day."""
    travel_days: NonNegativeFloat = 0.0
    """Days of travel and set-up of each person."""
    fixed: NonNegativeFloat = 0.0
    """Cost that does not depend on the days, such as transport."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the rates of a TOML file.

        Parameters
        ----------
        path
            TOML file with one entry for each rate.

        Returns
        -------
        Rates
            The rates; those that the file leaves out have their defaults.
        """
        return validated(cls, read_toml(path), str(path))

    def field_work(self, time_s: float, n_rovers: int) -> FieldWork:
        """Return days, person-days and cost of a survey.

        Parameters
        ----------
        time_s
            Time until the last rover is done [s].
        n_rovers
            Number of rovers.

        Returns
        -------
        FieldWork
            Days, person-days of all people with their travel, and cost.
        """
        days = max(math.ceil(time_s / (3600.0 * self.hours_a_day)), 1)
        person_days = self.people * (days + self.travel_days)
        cost = person_days * self.person_day + days * n_rovers * self.rover_day + self.fixed
        return FieldWork(days, person_days, cost, self.currency)
