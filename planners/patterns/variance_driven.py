"""Variance-driven path: waypoints are inserted where they lower the predicted variance most per metre.

Candidates are the nodes of a square lattice on the free ground. Cost-benefit insertion evaluates the six with the
greatest expected gain per added metre and inserts the best of them, until the budget is used or the wanted error is
predicted. The search is greedy: it looks one waypoint ahead.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
import shapely
from pydantic import Field, PositiveFloat, model_validator

from planners.config import Corner, PatternConfig
from planners.patterns.planner import LayoutTask, Planner, always
from planners.swaths.reference_lines import towards
from survey import InputError, Leg, Route, SurveyArea
from survey.core import FloatArray

if TYPE_CHECKING:
    from planners.prediction.error_model import ErrorModel


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


# The gain of one sample at a place only ranks the insertions; a full prediction takes long and is made for the first ones.
_MOST_TRIED = 6
_MOST_SAMPLES = 500


@dataclass(frozen=True)
class _Insertion:
    path: FloatArray
    added_m: float


def variance_driven(
    area: SurveyArea,
    config: VarianceDrivenConfig,
    model: "ErrorModel",
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Leg, ...]:
    """Build a path by cost-benefit insertion.

    Candidates are the nodes of a square lattice on the free ground. At every turn the six
    with the greatest expected gain per added metre at their cheapest place are evaluated
    fully, and the best of them is inserted, until the budget is used or the wanted error is
    predicted. The search is greedy: it looks one waypoint ahead.
    """
    lattice = _lattice(area, config.n_places)
    ground = area.free.buffer(1e-6)
    shapely.prepare(ground)
    first = area.starts[0] if len(area.starts) else lattice[np.argmax(lattice @ towards(config.start))]
    path = first[None, :]
    while not _is_done(path, config, model):
        room_m = np.inf if config.budget_m is None else config.budget_m - _length_m(path)
        insertions = [
            _cheapest(path, place, ground) for place in lattice if not (path == place).all(axis=1).any()
        ]
        fitting = [i for i in insertions if i is not None and i.added_m <= room_m]
        if not fitting:
            break
        path = _best(path, fitting, model).path
        if progress is not None:
            progress("inserting waypoints", len(path), len(lattice) + 1)
    if len(path) < 2:
        raise InputError("no waypoint fits the budget; allow more metres.")
    if config.rmse_m is not None and _rmse_m(path, model) > config.rmse_m:
        raise InputError(
            f"a path through all {len(lattice)} candidate places is predicted to err {_rmse_m(path, model):.2f} m, more than the "
            f"{config.rmse_m:g} m wanted; raise n_places, lower the noise or ask for less."
        )
    return (Leg("swath", path),)


def _lattice(area: SurveyArea, n_places: int) -> FloatArray:
    xmin, ymin, xmax, ymax = area.bounds
    cell = max(xmax - xmin, ymax - ymin) / n_places
    n_x, n_y = (max(round((high - low) / cell), 1) for low, high in ((xmin, xmax), (ymin, ymax)))
    x = xmin + (np.arange(n_x) + 0.5) * (xmax - xmin) / n_x
    y = ymin + (np.arange(n_y) + 0.5) * (ymax - ymin) / n_y
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside: FloatArray = nodes[area.contains(nodes)]
    if len(inside) < 2:
        raise InputError(f"{len(inside)} candidate places lie on the free ground; raise n_places.")
    return inside


def _cheapest(path: FloatArray, place: FloatArray, ground: shapely.Geometry) -> _Insertion | None:
    """Return the path with the place put in where it adds least, at the end included; None if no way is free."""
    legs = np.hypot(*(path - place).T)
    added = np.r_[legs[:-1] + legs[1:] - np.hypot(*np.diff(path, axis=0).T), legs[-1]]
    for at in np.argsort(added, kind="stable")[:4]:
        new = np.insert(path, at + 1, place, axis=0)
        if ground.covers(shapely.linestrings(new[at : at + 3])):
            return _Insertion(new, float(added[at]))
    return None


def _best(path: FloatArray, insertions: list[_Insertion], model: "ErrorModel") -> _Insertion:
    """Return the insertion that lowers the variance most per added metre."""
    before = _variance(path, model)
    cost = np.array([max(i.added_m, model.errors.sample_step_m) for i in insertions])
    expected = _gain_of_places(path, insertions, model) / cost
    tried = np.argsort(-expected, kind="stable")[:_MOST_TRIED]
    gain = [(before - _variance(insertions[i].path, model)) / cost[i] for i in tried]
    return insertions[int(tried[int(np.argmax(gain))])]


def _gain_of_places(path: FloatArray, insertions: list[_Insertion], model: "ErrorModel") -> FloatArray:
    """Return what one sample at each new place would explain of the nodes' variance."""
    new = np.array([_new_place(path, insertion.path) for insertion in insertions])
    xy, factor = _samples(path, model)
    one = model.posterior.likeliest
    noise_m = factor * one.noise_m
    from survey.reconstruction.gp.engines.regression import DenseGaussianProcess

    gp = DenseGaussianProcess.fit(
        xy, np.zeros(len(xy)), np.full(len(xy), noise_m), one.kernel, trend="constant"
    )
    shared = gp.covariance(model.nodes, new)
    gain: FloatArray = (shared**2).sum(axis=0) / (gp.predict(new)[1] + noise_m**2)
    return gain


def _new_place(old: FloatArray, new: FloatArray) -> FloatArray:
    at = next((i for i in range(len(old)) if (old[i] != new[i]).any()), len(old))
    place: FloatArray = new[at]
    return place


def _samples(path: FloatArray, model: "ErrorModel") -> tuple[FloatArray, float]:
    """Return samples along a path and the factor of their errors; at most 500, each standing for its neighbours."""
    length, step_m = _length_m(path), model.errors.sample_step_m
    step = max(step_m, length / _MOST_SAMPLES)
    factor = float(np.sqrt(step_m / step))
    if len(path) < 2:
        return path, factor
    at = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T))]
    stations = np.arange(0.0, length + 1e-9, step)
    return np.column_stack([np.interp(stations, at, path[:, k]) for k in (0, 1)]), factor


def _variance(path: FloatArray, model: "ErrorModel") -> float:
    xy, factor = _samples(path, model)
    return float(model.variance(xy, factor).sum())


def _rmse_m(path: FloatArray, model: "ErrorModel") -> float:
    return float(np.sqrt(_variance(path, model) / len(model.nodes)))


def _length_m(path: FloatArray) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _is_done(path: FloatArray, config: VarianceDrivenConfig, model: "ErrorModel") -> bool:
    return config.rmse_m is not None and len(path) > 1 and _rmse_m(path, model) <= config.rmse_m


def _layout(config: VarianceDrivenConfig, task: LayoutTask) -> Route:
    """Insert waypoints until the budget is used or the wanted error is predicted."""
    model = task.required_model(config.pattern)
    return Route(variance_driven(task.area, config, model, task.progress), task.area.crs, config.pattern)


VARIANCE_DRIVEN = Planner(VarianceDrivenConfig, _layout, needs_kernel=always, is_for_fleets=False)
"""Entry of the registry."""
