"""Description of a planner: its configuration, its layout, and what it needs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from planners.config import PatternConfig
from planners.routes.rover import Crew
from planners.steering import Steering
from survey import InputError, Route, SurveyArea
from survey.core import Progress

if TYPE_CHECKING:
    # A configuration is imported without the packages that predict errors.
    from planners.prediction.error_model import ErrorModel


class LayoutTask(NamedTuple):
    """Input of a layout.

    `area`: the area cut to drivable ground. `crew`: rovers, fleet and prior elevations, with lengths in grid
    metres. `model`: where a covariance of the terrain is given. `progress`: called with what is done, how
    much of it, and of how much.
    """

    area: SurveyArea
    crew: Crew
    model: "ErrorModel | None" = None
    progress: Progress | None = None

    @property
    def slope_length_m(self) -> float | None:
        """Distance over which the terrain's slopes change [m]; None without a covariance."""
        return None if self.model is None else self.model.slope_length_m

    def required_model(self, pattern: str) -> "ErrorModel":
        """Return the error model, or refuse when there is none."""
        if self.model is None:
            raise InputError(
                f"the pattern {pattern} needs a covariance of the terrain; give a prior or a kernel."
            )
        return self.model


def never(config: Any) -> bool:  # noqa: ARG001
    """Return False for every configuration."""
    return False


def always(config: Any) -> bool:  # noqa: ARG001
    """Return True for every configuration."""
    return True


@dataclass(frozen=True)
class Planner:
    """Entry of the registry of planners.

    `config`: configuration model; the default of its field ``pattern`` is the planner's name. `layout`:
    returns the route for a configuration and a `LayoutTask`. `needs_kernel`: whether a configuration needs a
    covariance of the terrain. `steering`: returns the `Steering` of a pattern that is steered while driving.
    The layout then gives the reference swaths. `is_for_fleets`: whether the layout takes turning radii,
    batteries, several rovers and a place to finish into account.
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
