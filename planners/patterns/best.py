"""Best swaths: straight or wavy, with the heading, inset and spacing of least predicted error.

`choose` compares straight swaths first, then the default waves, then other borders, lengths and steepnesses of the
waves. Every candidate gets as many swaths as the budget allows, or as few as the wanted error needs. The lawnmower
with an inset and the default waves are among the candidates, so the choice is never predicted to be worse than either.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Literal, Self

from pydantic import PositiveFloat, PositiveInt, model_validator

from planners.config import Corner, PatternConfig
from planners.patterns.lawnmower import LAWNMOWER, LawnmowerConfig
from planners.patterns.planner import LayoutTask, Planner, always
from planners.patterns.wavy import WAVY, LinePattern, WavyConfig
from planners.routes.rover import Crew
from planners.swaths.reference_lines import narrowest_heading
from survey import InputError, Route, SurveyArea
from survey.core import Progress

if TYPE_CHECKING:
    from planners.prediction.error_model import ErrorModel


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


INSET_SHARE = 0.5
"""The inset of the lawnmower that the choice is never worse than, in spacings."""

_BORDERS = ((INSET_SHARE, 0.5), (0.25, 0.35), (0.35, 0.35), (0.5, 0.4), (0.65, 0.4))
"""Inset of the ends and place of the outer lines that are compared, in spacings."""

# About the defaults of `WavyConfig`, 0.6 and 0.85.
_STEEPNESSES = (0.3, 0.45, 0.6, 0.8)
_WAVELENGTH_SCALES = (0.7, 0.85, 1.0, 1.25)
_MOST_SAMPLES = 700
_MOST_SWATHS = 200

_LAYOUTS = {planner.name: planner.layout for planner in (LAWNMOWER, WAVY)}


@dataclass(frozen=True)
class Choice:
    """Route with its settings and its predicted error.

    `config`: settings that give the route. `route`: the route, without a prediction. `rmse_m`: predicted root
    mean square error of the map [m].
    """

    config: LinePattern
    route: Route
    rmse_m: float


Sizer = Callable[[LinePattern], Choice | None]


def choose(
    area: SurveyArea,
    config: BestConfig,
    model: "ErrorModel",
    *,
    crew: Crew | None = None,
    progress: Progress | None = None,
) -> Choice:
    """Choose the swaths of least predicted error, sensor noise included.

    Straight swaths are compared first, over headings and distances from the border; then
    the default waves over the same headings, and about the best of these other borders,
    lengths and steepnesses. Every candidate gets as many swaths as the budget allows, or
    as few as the wanted error needs. The inset lawnmower and the default waves are among
    the candidates, so the choice is never worse than either as the
    covariance of `model` has it.

    >>> from planners.prediction.error_model import ErrorModel
    >>> from survey.reconstruction.gp.kernels import SquaredExponential
    >>> area = SurveyArea.rectangle((0.0, 0.0, 300.0, 300.0), "EPSG:32608")
    >>> model = ErrorModel.of(area, SquaredExponential(20.0, 90.0), noise_m=0.1, cell_m=30.0)
    >>> choose(area, BestConfig(swaths=2), model).route.length_m <= 750.0
    True
    """
    lay = partial(_laid, LayoutTask(area, crew or Crew(), model))
    quick = model.for_comparisons()
    sized = _counted(_sizer(lay, config, quick), _n_shapes(area, config), progress)
    value = _least(config)

    def best_of(shapes: Iterable[LinePattern]) -> Choice:
        choices = [choice for shape in shapes if (choice := sized(shape)) is not None]
        if not choices:
            raise InputError("not even one swath fits the budget; allow more metres.")
        return min(choices, key=value)

    straight = best_of(_straight(area, config))
    turned = best_of(_replaced(straight.config, heading_deg=heading) for heading in _headings(area, config))
    wavy = best_of(_default_wave(heading, config, model) for heading in _headings(area, config))
    best = min(straight, turned, wavy, best_of(_waves_like(wavy.config, model)), key=value)
    return best if quick is model else _confirmed(best, lay, config, model)


def _confirmed(
    best: Choice, lay: Callable[[LinePattern], Route], config: BestConfig, model: "ErrorModel"
) -> Choice:
    """Return a choice with the error that the complete model predicts, and as many swaths as a wanted error needs."""

    def of(n: int) -> Choice:
        shape = _replaced(best.config, swaths=n)
        route = lay(shape)
        return Choice(shape, route, model.rmse_m(route))

    if config.rmse_m is None:
        return replace(best, rmse_m=model.rmse_m(best.route))
    return _fewest(of, config.rmse_m, first=best.config.swaths or 1)


def _laid(task: LayoutTask, shape: LinePattern) -> Route:
    """Return the route of a shape."""
    return _LAYOUTS[shape.pattern](shape, task)


def _replaced(shape: LinePattern, **changes: object) -> LinePattern:
    """Return a shape with other settings."""
    return shape.model_copy(update=changes)


def _least(config: BestConfig) -> Callable[[Choice], float]:
    """Return what is to be small: the length to a wanted error, or the error within a budget."""
    if config.rmse_m is not None:
        return lambda choice: choice.route.length_m
    return lambda choice: choice.rmse_m


def _headings(area: SurveyArea, config: BestConfig) -> list[float]:
    if config.heading_deg is not None:
        return [config.heading_deg]
    first = narrowest_heading(area.free)
    return [first, first + 90.0, first + 45.0, first - 45.0]


def _straight(area: SurveyArea, config: BestConfig) -> Iterator[LinePattern]:
    heading = _headings(area, config)[0]
    for inset, outer in _BORDERS:
        yield LawnmowerConfig(
            swaths=1, heading_deg=heading, start=config.start, outer_share=outer, inset_share=inset
        )


def _default_wave(heading_deg: float, config: BestConfig, model: "ErrorModel") -> LinePattern:
    shape = WavyConfig(swaths=1, heading_deg=heading_deg, start=config.start)
    return _replaced(shape, wavelength_m=shape.wavelength_scales * model.slope_length_m)


def _waves_like(wave: LinePattern, model: "ErrorModel") -> Iterator[LinePattern]:
    for inset, outer in _BORDERS:
        yield _replaced(wave, inset_share=inset, outer_share=outer)
    for steepness in _STEEPNESSES:
        for scales in _WAVELENGTH_SCALES:
            yield _replaced(wave, steepness=steepness, wavelength_m=scales * model.slope_length_m)


def _n_shapes(area: SurveyArea, config: BestConfig) -> int:
    return 2 * len(_BORDERS) + 2 * len(_headings(area, config)) + len(_STEEPNESSES) * len(_WAVELENGTH_SCALES)


def _counted(sized: Sizer, n_shapes: int, progress: Progress | None) -> Sizer:
    """Return the same function, which reports progress after each call."""
    n_done = count(1)

    def reporting(shape: LinePattern) -> Choice | None:
        choice = sized(shape)
        if progress is not None:
            progress("comparing patterns", next(n_done), n_shapes)
        return choice

    return reporting


def _sizer(lay: Callable[[LinePattern], Route], config: BestConfig, model: "ErrorModel") -> Sizer:
    """Return the function that gives a shape its number of swaths."""

    def of(shape: LinePattern, n: int) -> Choice:
        sized = _replaced(shape, swaths=n)
        route = lay(sized)
        return Choice(sized, route, model.rmse_m(route, _MOST_SAMPLES))

    if config.rmse_m is not None:
        wanted_m = config.rmse_m
        return lambda shape: _fewest(lambda n: of(shape, n), wanted_m)
    budget_m = _budget_m(lay, config)

    def within(shape: LinePattern) -> Choice | None:
        n = _most(lambda n: lay(_replaced(shape, swaths=n)).length_m, budget_m)
        return of(shape, n) if n else None

    return within


def _budget_m(lay: Callable[[LinePattern], Route], config: BestConfig) -> float:
    if config.budget_m is not None:
        return config.budget_m
    plain = LawnmowerConfig(swaths=config.swaths, spacing_m=config.spacing_m, heading_deg=config.heading_deg)
    return lay(plain).length_m


def _most(length_m: Callable[[int], float], budget_m: float) -> int:
    """Return the largest number of swaths within a budget; 0 when one is too long."""
    low, high = 0, 1
    while high <= _MOST_SWATHS and length_m(high) <= budget_m:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if length_m(middle) <= budget_m else (low, middle)
    return low


def _fewest(choice: Callable[[int], Choice], rmse_m: float, first: int = 1) -> Choice:
    """Return the choice with the fewest swaths that is predicted to reach the wanted error, sought from `first` on."""
    low, high = 0, first
    found = choice(high)
    while found.rmse_m > rmse_m:
        low, high = high, 2 * high
        if high > _MOST_SWATHS:
            raise InputError(
                f"{low} swaths are predicted to err {found.rmse_m:.2f} m, more than the {rmse_m:g} m wanted; lower the noise of "
                "the samples or ask for less."
            )
        found = choice(high)
    while high - low > 1:
        middle = (low + high) // 2
        tried = choice(middle)
        if tried.rmse_m <= rmse_m:
            high, found = middle, tried
        else:
            low = middle
    return found


def _layout(config: BestConfig, task: LayoutTask) -> Route:
    """Compare patterns and return the route of the best one."""
    model = task.required_model(config.pattern)
    return choose(task.area, config, model, crew=task.crew, progress=task.progress).route


BEST = Planner(BestConfig, _layout, needs_kernel=always)
"""Entry of the registry."""
