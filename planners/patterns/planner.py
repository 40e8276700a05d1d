"""Description of a planner: its configuration, its layout, and what it needs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from planners.config import PatternConfig
from planners.driving.rover import Crew
from planners.prediction.predict import ErrorModel
from planners.steering.steering import Steering
from planners.swaths.wavy import slope_length_m
from survey.core.arrays import Progress
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.route import Route


class LayoutTask(NamedTuple):
    """Input of a layout.

    ``area`` is the area cut to drivable ground, ``crew`` the rovers with the prior elevations,
    ``model`` the error model where a covariance of the terrain is given.
    """

    area: SurveyArea
    crew: Crew
    model: ErrorModel | None = None
    progress: Progress | None = None

    @property
    def slope_length_m(self) -> float | None:
        """Distance over which the terrain's slopes change [m]; None without a covariance."""
        return None if self.model is None else slope_length_m(self.model.kernel)

    def required_model(self, pattern: str) -> ErrorModel:
        """Return the error model, or refuse when there is none.

        Raises
        ------
        InputError
            No covariance of the terrain is given.
        """
        if self.model is None:
            raise InputError(
                f"the pattern {pattern} needs a covariance of the terrain; give a prior or a kernel."
            )
        return self.model


def never(_: Any) -> bool:
    """Return False."""
    return False


def always(_: Any) -> bool:
    """Return True."""
    return True


@dataclass(frozen=True)
class Planner:
    """Entry of the registry of planners.

    Parameters
    ----------
    config : type
        Configuration model; the default of its field ``pattern`` is the planner's name.
    layout : callable
        Returns the route for a configuration and a `LayoutTask`.
    needs_kernel : callable
        Whether a configuration needs a covariance of the terrain.
    steering : callable, optional
        Returns the `Steering` of a pattern that is steered while driving. The layout then
        gives the reference swaths.
    is_for_fleets : bool
        Whether the layout takes turning radii, batteries, several rovers and a place to
        finish into account.
    """

    config: type[PatternConfig]
    layout: Callable[[Any, LayoutTask], Route]
    needs_kernel: Callable[[Any], bool] = never
    steering: Callable[[Any], Steering] | None = None
    is_for_fleets: bool = True

    @property
    def name(self) -> str:
        """Name of the pattern, as in a mission file."""
        return str(self.config.model_fields["pattern"].default)
