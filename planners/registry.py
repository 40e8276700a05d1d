"""Registry of planners: one line per planner; a new planner is its own module and one line here."""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import Field

from planners.config import PatternConfig
from planners.patterns.best import BEST
from planners.patterns.lawnmower import LAWNMOWER
from planners.patterns.piecewise_continuous import PIECEWISE_CONTINUOUS
from planners.patterns.planner import Planner
from planners.patterns.random_wander import RANDOM_WANDER
from planners.patterns.variance_driven import VARIANCE_DRIVEN
from planners.patterns.wavy import WAVY
from planners.steering import Steering
from survey.core import ConfigError, Section, validated

PLANNERS: tuple[Planner, ...] = (LAWNMOWER, WAVY, PIECEWISE_CONTINUOUS, RANDOM_WANDER, VARIANCE_DRIVEN, BEST)
"""All planners, in the order in which they are listed for users."""

_BY_CONFIG = {planner.config: planner for planner in PLANNERS}

# The members of the union are those of the registry; type checkers see their common base.
if TYPE_CHECKING:
    PlannerConfig: TypeAlias = PatternConfig
else:
    PlannerConfig = Annotated[reduce(or_, _BY_CONFIG), Field(discriminator="pattern")]


def pattern_names() -> tuple[str, ...]:
    """Return the names of all planners.

    >>> pattern_names()[:2]
    ('lawnmower', 'wavy')
    """
    return tuple(planner.name for planner in PLANNERS)


def planner_of(config: Any) -> Planner:
    """Return the registry entry of a configuration.

    >>> from planners import LawnmowerConfig
    >>> planner_of(LawnmowerConfig(swaths=4)).name
    'lawnmower'
    """
    planner = _BY_CONFIG.get(type(config))
    if planner is None:
        known = ", ".join(kind.__name__ for kind in _BY_CONFIG)
        raise TypeError(
            f"the planner is {config!r} ({type(config).__name__}); one of {known} was expected, "
            "e.g. LawnmowerConfig(swaths=4)."
        )
    return planner


def steering_of(config: PatternConfig) -> Steering | None:
    """Return the steering of a pattern that is steered while driving.

    Returns: None for a pattern whose route is fixed before the drive.

    >>> from planners import LawnmowerConfig, RandomWanderConfig
    >>> steering_of(LawnmowerConfig(swaths=4)) is None
    True
    >>> steering_of(RandomWanderConfig(swaths=4)).step_m
    10.0
    """
    steering = planner_of(config).steering
    return None if steering is None else steering(config)


class _Holder(Section):
    """One planner, so that its settings are checked like those of a mission."""

    planner: PlannerConfig


def planner_config(values: dict[str, Any], where: str) -> PatternConfig:
    """Return the configuration of a planner from plain values.

    >>> planner_config({"pattern": "wavy", "swaths": 3}, "the options").swaths
    3
    """
    pattern, known = values.get("pattern"), pattern_names()
    if pattern not in known:
        raise ConfigError(
            f"{where}: the planner {pattern!r} is not known; one of {', '.join(known)} was expected."
        )
    return validated(_Holder, {"planner": values}, where).planner
