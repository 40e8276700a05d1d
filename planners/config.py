"""Configurations of planners; lengths in metres on the ground, angles in degrees."""

from typing import TYPE_CHECKING, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from survey.core.config import Section

Corner = Literal["south-west", "south-east", "north-west", "north-east"]
HeadingRule = Literal["narrowest", "fewest-swaths", "slope", "grain"]


class PatternConfig(Section):
    """Base of all configurations of planners.

    Subclasses have a field ``pattern`` whose only value is the planner's name.
    """

    if TYPE_CHECKING:
        # A field of the base would come first in every file that is written.
        pattern: str


class SwathConfig(PatternConfig):
    """Parallel reference lines over the area: how many, which way, how far from the border."""

    swaths: PositiveInt | None = None
    """Number of swaths; give this or `spacing_m`."""
    spacing_m: PositiveFloat | None = None
    """Ground sample spacing: the largest distance between neighbouring swaths [m]."""
    heading_deg: float | None = None
    """Direction of the swaths, counter-clockwise from east [deg]; by `heading_rule` when left out."""
    heading_rule: HeadingRule = "narrowest"
    """Along the longer side, with the fewest swaths (needs `spacing_m`), up the slope, or across the terrain's grain."""
    start: Corner | None = None
    """Corner of the first swath; the one nearest to the area's first start, else the south-western one."""
    outer_share: float = Field(default=0.5, gt=0.0, le=1.0)
    """Distance of the outermost swaths from the border, in spacings."""
    inset_share: NonNegativeFloat = 0.0
    """How far swaths end before the border, in spacings."""
    tie_lines: NonNegativeInt = 0
    """Number of lines driven across the swaths at the end."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.swaths is None) == (self.spacing_m is None):
            raise ValueError("give either swaths or spacing_m")
        return self


class LawnmowerConfig(SwathConfig):
    """Straight swaths at ``(i + 1/2) L / n``, driven back and forth from border to border (glacier paper, III.A).

    With an ``inset_share`` of about 0.5 the rover no longer drives to the fence, where
    half of what it could measure lies outside: 10 to 35 % less distance for the same map.

    Examples
    --------
    >>> LawnmowerConfig(swaths=4).inset_share
    0.0
    """

    pattern: Literal["lawnmower"] = "lawnmower"
    """Name of the pattern."""


class WavyConfig(SwathConfig):
    """Swaths that wind about their lines, so that they also measure how the terrain changes across them.

    The defaults were chosen on random terrain of five kinds, with and without noise, other
    than the terrain on which the benchmark judges them.
    """

    pattern: Literal["wavy"] = "wavy"
    """Name of the pattern."""
    outer_share: float = Field(default=0.35, gt=0.0, le=1.0)
    """Distance of the outermost lines from the border, in spacings."""
    inset_share: NonNegativeFloat = 0.25
    """How far swaths end before the border, in spacings."""
    steepness: float = Field(default=0.6, ge=0.0, le=2.0)
    """Greatest slope of the wave against its line; 0.6 turns the rover by 31° and makes swaths 8 % longer."""
    amplitude_share: float = Field(default=0.25, ge=0.0, le=0.5)
    """Greatest distance from the line, in spacings."""
    wavelength_m: PositiveFloat | None = None
    """Length of a wave [m]; `wavelength_scales` slope lengths of the terrain when left out."""
    wavelength_scales: PositiveFloat = 0.85
    """Length of a wave in slope lengths: ℓ of a squared exponential, ℓ/√3 of a Matérn 3/2 covariance."""


class SteeredConfig(SwathConfig):
    """Swaths that the rover deviates from while it drives."""

    step_m: PositiveFloat = 10.0
    """Distance driven between two decisions [m]."""
    candidates_deg: tuple[float, ...] = Field(default=(-45.0, 0.0, 45.0), min_length=1, strict=False)
    """Headings to choose from, counter-clockwise from the swath's, within 80° of it [deg]."""
    toggle_probability: float = Field(default=0.1, ge=0.0, le=1.0)
    """Chance per step that the rule is switched."""
    band_share: float = Field(default=0.5, ge=0.0, le=0.5)
    """Greatest distance from the swath, in spacings."""

    @model_validator(mode="after")
    def _forward(self) -> Self:
        if max(abs(candidate) for candidate in self.candidates_deg) > 80.0:
            raise ValueError(
                "candidates_deg must lie within 80 degrees of the swath, or the rover would not advance"
            )
        return self


class PiecewiseContinuousConfig(SteeredConfig):
    """The glacier paper's second pattern (Eq. 10): steepest ascent or descent about a swath, switched at random.

    The paper leaves step, candidates, switching and bounds open; these are the values
    read into it. The route is made while driving: see `planners.steering.steering`.
    """

    pattern: Literal["piecewise-continuous"] = "piecewise-continuous"
    """Name of the pattern."""


class RandomWanderConfig(SteeredConfig):
    """Control of the piecewise-continuous pattern: the same steps and turns, chosen at random."""

    pattern: Literal["random-wander"] = "random-wander"
    """Name of the pattern."""


class VarianceDrivenConfig(PatternConfig):
    """A path that goes where the map is predicted to be least certain; give a budget or a wanted error."""

    pattern: Literal["variance-driven"] = "variance-driven"
    """Name of the pattern."""
    budget_m: PositiveFloat | None = None
    """Distance that may be driven [m]; give this or `rmse_m`."""
    rmse_m: PositiveFloat | None = None
    """Predicted root-mean-square error to reach [m]."""
    n_places: int = Field(default=12, ge=3, le=40)
    """Number of candidate waypoints along the longer side of the area."""
    start: Corner | None = None
    """Corner to begin at; the one nearest to the area's first start, else the south-western one."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.budget_m is None) == (self.rmse_m is None):
            raise ValueError("give either budget_m or rmse_m")
        return self


class BestConfig(PatternConfig):
    """The swaths of least predicted error: straight or wavy, their heading, inset and spacing are chosen."""

    pattern: Literal["best"] = "best"
    """Name of the pattern."""
    swaths: PositiveInt | None = None
    """As far as the plain lawnmower of so many swaths drives; give this or one of the next three."""
    spacing_m: PositiveFloat | None = None
    """As far as the plain lawnmower of this spacing drives [m]."""
    budget_m: PositiveFloat | None = None
    """Distance that may be driven [m]."""
    rmse_m: PositiveFloat | None = None
    """Predicted root-mean-square error to reach by the shortest route [m]."""
    heading_deg: float | None = None
    """Direction of the swaths [deg]; four headings are compared when left out."""
    start: Corner | None = None
    """Corner of the first swath."""

    @model_validator(mode="after")
    def _one_of_four(self) -> Self:
        if [self.swaths, self.spacing_m, self.budget_m, self.rmse_m].count(None) != 3:
            raise ValueError("give one of swaths, spacing_m, budget_m and rmse_m")
        return self
