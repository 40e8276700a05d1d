"""Plan while a survey is drawn: routes and predicted errors of a document, with a cache of repeated results."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, Generic, NamedTuple, TypeVar

from pyproj import CRS

import planners
from desk.plan.document import PlanDocument
from desk.plan.request import request_of
from firnline.actions.interface import read_about
from firnline.actions.plan_request import PlanRequest
from firnline.actions.planning import AreaPlan, area_plan, checked_options
from planners.prediction.error_model import ErrorModel
from planners.routes.rover import Crew, homes_of
from survey import Dem, InputError, SurveyArea
from survey.core.arrays import Bounds

_MOST = 24
# Cells of the prior beyond an outline that slopes at its edge need; a provisional plan uses no others.
_REACH_CELLS = 3.0
Value = TypeVar("Value")


class ResultCache(Generic[Value]):
    """Results by key, the latest ones; each is computed once, also when several threads ask for it.

    >>> squares = ResultCache[int]()
    >>> squares.computed(3, lambda: 9), squares.get(3), squares.get(4)
    (9, 9, None)
    """

    def __init__(self) -> None:
        self._values: OrderedDict[Hashable, Value] = OrderedDict()
        self._busy: dict[Hashable, Lock] = {}
        self._lock = Lock()

    def get(self, key: Hashable) -> Value | None:
        """Return a result that is there; None for another key."""
        with self._lock:
            return self._values.get(key)

    def latest(self) -> Value | None:
        """Return the result that was asked for last."""
        with self._lock:
            return next(reversed(self._values.values()), None)

    def computed(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """Return a result, computed where it is not there yet."""
        with self._lock:
            busy = self._busy.setdefault(key, Lock())
        try:
            with busy:
                found = self.get(key)
                return self._store(key, compute() if found is None else found)
        finally:
            with self._lock:
                self._busy.pop(key, None)

    def _store(self, key: Hashable, value: Value) -> Value:
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > _MOST:
                self._values.popitem(last=False)
        return value


class LivePlan(NamedTuple):
    """Plan of a document.

    `plan`: route, prior, covariance, ground that is left out. `is_provisional`: whether the covariance is
    that of an earlier outline, or not known yet. `no_error_because`: why no error is predicted; empty when it
    is.
    """

    plan: AreaPlan
    is_provisional: bool
    no_error_because: str


class Fitted(NamedTuple):
    """Predictor of errors over an outline, or why there is none."""

    model: ErrorModel | None
    refusal: str


class LivePlanner:
    """Planner of the documents over one terrain.

    The covariance of the terrain is fitted to the prior over the bounds of the outline, which takes
    seconds. While an outline is being changed, routes and errors are first computed with the covariance of the
    outline before, and said to be provisional.

    `terrain`: raster of prior elevations. `crs`: projected CRS of the documents.
    """

    def __init__(self, terrain: Path, crs: CRS) -> None:
        self.terrain = terrain
        self.crs = crs
        self._priors: ResultCache[Dem] = ResultCache()
        self._models: ResultCache[Fitted] = ResultCache()
        self._plans: ResultCache[AreaPlan] = ResultCache()
        self._planning = Lock()

    def quick(self, document: PlanDocument) -> LivePlan:
        """Plan with the covariance that is at hand."""
        area = document.survey_area(self.crs)
        fitted = self._models.get(self._key(document, area))
        if fitted is not None:
            return self._with(document, area, fitted, self.prior(area), is_provisional=False)
        prior = self._prior_at_hand(area)
        return self._with(document, area, self._moved(area, prior), prior, is_provisional=True)

    def exact(self, document: PlanDocument) -> LivePlan:
        """Plan with the covariance of the document's outline, as ``firnline plan`` does; see `quick`."""
        area = document.survey_area(self.crs)
        key = self._key(document, area)
        fitted = self._models.computed(key, lambda: self._fitted(area, self._request(document).assumptions))
        return self._with(document, area, fitted, self.prior(area), is_provisional=False)

    def prior(self, area: SurveyArea) -> Dem:
        """Return the prior elevations about an area."""
        return self._priors.computed(area.bounds, lambda: self._read(area.bounds, area.crs))

    def _prior_at_hand(self, area: SurveyArea) -> Dem:
        """Return the elevations of the outline before where they reach about this one: a corner that is moved reads none."""
        latest = self._priors.latest()
        if latest is not None:
            west, south, east, north = area.bounds
            low_x, low_y, high_x, high_y = latest.bounds
            reach_m = _REACH_CELLS * latest.step_m
            if min(west - low_x, south - low_y, high_x - east, high_y - north) >= reach_m:
                return latest
        return self.prior(area)

    def _read(self, bounds: Bounds, crs: CRS) -> Dem:
        return read_about(self.terrain, bounds, crs, "the prior")

    def _request(self, document: PlanDocument) -> PlanRequest:
        return request_of(document, Path("site.gpkg"), self.terrain, Path("route.geojson"))

    def _key(self, document: PlanDocument, area: SurveyArea) -> Hashable:
        """Return what decides the predictor of errors."""
        return area.free.wkb, self._request(document).assumptions

    def _fitted(self, area: SurveyArea, assumed: planners.MapAssumptions) -> Fitted:
        try:
            return Fitted(planners.prior_model(self.prior(area), area, assumed), "")
        except InputError as error:
            return Fitted(None, str(error))

    def _moved(self, area: SurveyArea, prior: Dem) -> Fitted:
        """Return the predictor of the outline before, for another outline."""
        latest = self._models.latest()
        if latest is None or latest.model is None:
            return Fitted(None, "")
        return Fitted(latest.model.over(area, prior), "")

    def _with(
        self, document: PlanDocument, area: SurveyArea, fitted: Fitted, prior: Dem, *, is_provisional: bool
    ) -> LivePlan:
        posterior = None if fitted.model is None else fitted.model.posterior
        key = (
            document.model_dump_json(exclude={"requirement", "notes"}),
            self._request(document).assumptions,
            posterior,
            prior.bounds,
        )
        plan = self._plans.computed(key, lambda: self._planned(document, area, prior, fitted.model))
        return LivePlan(plan, is_provisional, fitted.refusal)

    def _planned(
        self, document: PlanDocument, area: SurveyArea, prior: Dem, model: ErrorModel | None
    ) -> AreaPlan:
        config: Any = checked_options(self._request(document))
        homes_of(area, Crew(config.rover, config.fleet))
        with self._planning:
            return area_plan(config, area, prior, model)


@cache
def plan_once() -> None:
    """Plan two small areas, one with a corner cut out, so that compiled code is loaded before the first plan."""
    cut_out = ((0.0, 0.0), (90.0, 0.0), (90.0, 60.0), (50.0, 60.0), (50.0, 90.0), (0.0, 90.0))
    oblique = ((0.0, 0.0), (93.0, -3.0), (90.0, 90.0), (0.0, 90.0))
    for corners, n_swaths in ((cut_out, 3), (oblique, 8)):
        area = PlanDocument(areas=((corners,),), starts=((5.0, 5.0),)).survey_area(CRS("EPSG:32608"))
        planners.plan(area, None, planners.LawnmowerConfig(swaths=n_swaths))
