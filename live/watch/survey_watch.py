"""State of a survey while it is driven: samples in, events out.

`SurveyWatch` takes samples and silences, updates the map, follows the rover along the planned legs (`LegProgress`), warns
of a rover that is stuck, silent or short of charge for the way home (`RoverWarnings`), and advises the next swath or the
end (`advised`). The rule is that of `planners.guarantee.adaptive`: the survey ends when the probability that its map
meets the limit is large enough. It may be evaluated after every swath, since a posterior probability keeps its meaning under
optional stopping.
"""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from live.watch.live_map import LiveMap
from live.watch.samples import Sample, SampleGate
from planners.config import settings_factor
from planners.guarantee.adaptive import AdaptiveConfig, AdaptiveState
from planners.prediction.error_distribution import MapPrediction
from survey import Dem, Grid, InputError, Leg, Route, SurveyArea
from survey.core.arrays import FloatArray
from survey.reconstruction.gp.kernels import Kernel
from survey.scoring.standards.map_classes import edition_2_class

_STUCK_S, _STUCK_M = 90.0, 1.5
_SILENT_S = 30.0
# Share of the charge that stays in the battery, and how much longer than straight the way home may be.
_RESERVE, _DETOUR = 0.1, 1.3
_LEAST_DRIVEN_M = 50.0


@dataclass
class RoverWarnings:
    """Conditions of one rover; each is reported once when it begins."""

    _start: Sample | None = None
    _moved: Sample | None = None
    _last_s: float = 0.0
    _standing: set[str] = field(default_factory=set)

    def of(self, sample: Sample, driven_m: float, is_over: bool) -> list[dict[str, Any]]:
        """Return the warnings that begin with a sample; a rover that has nothing left to drive (`is_over`) is not stuck."""
        self._start = self._start or sample
        if self._moved is None or is_over or _apart_m(self._moved, sample) > _STUCK_M:
            self._moved = sample
        self._last_s = sample.time_s
        still_s = sample.time_s - self._moved.time_s
        found = [*self._when("silent", False, sample.time_s, "")]
        found += self._when("stuck", still_s > _STUCK_S, sample.time_s, f"no movement for {still_s:.0f} s")
        return found + self._battery(sample, driven_m)

    def silent(self, time_s: float) -> list[dict[str, Any]]:
        """Return a warning when nothing has arrived for a while."""
        silent_s = time_s - self._last_s
        return self._when("silent", silent_s > _SILENT_S, time_s, f"nothing received for {silent_s:.0f} s")

    def _battery(self, sample: Sample, driven_m: float) -> list[dict[str, Any]]:
        """Compare the charge with what the way home takes at the rate so far."""
        start = self._start
        if start is None or start.battery is None or sample.battery is None or driven_m < _LEAST_DRIVEN_M:
            return []
        per_m = max(start.battery - sample.battery, 0.0) / driven_m
        home_m = _DETOUR * _apart_m(start, sample)
        needed = per_m * home_m + _RESERVE
        words = (
            f"{sample.battery:.0%} left, and the way home of {home_m:.0f} m needs {needed:.0%} with a reserve"
        )
        return self._when("battery", sample.battery < needed, sample.time_s, words)

    def _when(self, name: str, is_so: bool, time_s: float, words: str) -> list[dict[str, Any]]:
        """Return an event when a condition begins."""
        if not is_so:
            self._standing.discard(name)
            return []
        if name in self._standing:
            return []
        self._standing.add(name)
        return [{"event": "warning", "time_s": time_s, "about": name, "text": words}]


def _apart_m(one: Sample, other: Sample) -> float:
    return float(np.hypot(one.x_m - other.x_m, one.y_m - other.y_m))


# Share of its length by which the way along a leg may be longer or shorter than planned.
_ODD_SHARE = 0.2


class LegProgress:
    """Legs that a rover has driven, from the places it was at.

    A leg is driven when the rover has passed near its end, after most of its length. Between two places it counts as
    driven straight, so that telemetry may pause. A rover that is followed from the middle of its drive on, or again after
    a loss of the link, is found on a later leg once it has driven that from its beginning to its end; the legs before
    then count as driven.

    `legs`: in driving order; more may be added. `near_m`: distance from the end of a leg at which it counts
    as reached [m].

    >>> progress = LegProgress([Leg("swath", [[0.0, 0.0], [10.0, 0.0]])], near_m=1.0)
    >>> [progress.moved(np.array([x, 0.1])) for x in (0.0, 5.0, 9.5)]
    [(), (), (0,)]
    """

    def __init__(self, legs: list[Leg], near_m: float) -> None:
        self.legs, self.near_m = legs, near_m
        self.n_driven = 0
        self.driven_m = 0.0
        self._from_m = 0.0
        self._begun_m: dict[int, float] = {}
        self._last: FloatArray | None = None

    def moved(self, xy: FloatArray) -> tuple[int, ...]:
        """Take the next place (2,) [m]; return the legs that it completes.

        `xy` (2,): easting and northing [m].
        """
        last = xy if self._last is None else self._last
        self._last = xy
        self.driven_m += float(np.hypot(*(xy - last)))
        before = self.n_driven
        while (index := self._reached(last, xy)) is not None:
            self._from_m = self.driven_m - float(np.hypot(*(xy - self.legs[index].xy[-1])))
            self.n_driven = index + 1
        for index in range(self.n_driven + 1, len(self.legs)):
            if _gap_m(self.legs[index].xy[0], last, xy) <= self.near_m:
                self._begun_m[index] = self.driven_m
        return tuple(range(before, self.n_driven))

    def _reached(self, before: FloatArray, after: FloatArray) -> int | None:
        """Return the leg whose end was passed between two places, the nearest end of several."""
        gaps_m = {
            index: _gap_m(self.legs[index].xy[-1], before, after)
            for index in range(self.n_driven, len(self.legs))
            if self._may_end(index)
        }
        nearest = min(gaps_m, key=gaps_m.__getitem__, default=None)
        return None if nearest is None or gaps_m[nearest] > self.near_m else nearest

    def _may_end(self, index: int) -> bool:
        """Return whether the rover may be at the end of a leg by the way since its beginning; of later legs, of a swath."""
        leg = self.legs[index]
        if index == self.n_driven:
            return self.driven_m - self._from_m >= (1.0 - _ODD_SHARE) * leg.length_m - self.near_m
        if leg.kind != "swath" or index not in self._begun_m or leg.length_m < 4.0 * self.near_m:
            return False
        way_m = self.driven_m - self._begun_m[index]
        return abs(way_m - leg.length_m) <= _ODD_SHARE * leg.length_m + 2.0 * self.near_m

    @property
    def driven(self) -> list[Leg]:
        """Legs that were driven."""
        return self.legs[: self.n_driven]


def _gap_m(place: FloatArray, before: FloatArray, after: FloatArray) -> float:
    """Return the distance of a place from the straight way between two others [m]."""
    way, apart = after - before, place - before
    share = np.clip(np.dot(apart, way) / max(float(np.dot(way, way)), 1e-12), 0.0, 1.0)
    return float(np.hypot(*(apart - share * way)))


class Advice(NamedTuple):
    """What to do next.

    `now`: probability of the limit, and error, of the map of what was driven. `with_next`: the same with the
    next swath. `with_all`: the same with all swaths that are planned to follow. `legs`: way to the next swath
    and along it; empty where the survey ends. `is_met`: whether the limit holds with the probability asked
    for. `kernel`: likeliest covariance of the terrain. `unseen_m2`: variance of relief so fine that samples
    show it as noise [m²].
    """

    now: MapPrediction
    with_next: MapPrediction | None
    with_all: MapPrediction | None
    legs: tuple[Leg, ...]
    is_met: bool
    kernel: Kernel
    unseen_m2: float


def advised(
    area: SurveyArea, driven: list[Leg], xy: FloatArray, heights: FloatArray, config: AdaptiveConfig
) -> Advice:
    """Return the next swath, or that the survey ends.

    `xy`, `heights` (N, 2) and (N,): places and heights of the samples [m]. Returns: no legs and ``is_met``
    False where no survey of the swaths allowed would do.
    """
    in_grid = config.in_grid_metres(settings_factor(area))
    state = AdaptiveState.driven(area, Route(tuple(driven), area.crs, "adaptive"), xy, heights, in_grid)
    likeliest = state.posterior.likeliest
    now = state.predicted
    lines = None if state.is_met else state.further(in_grid.probability)
    if lines is None:
        return Advice(now, None, None, (), state.is_met, likeliest.kernel, likeliest.unseen_m2)
    line = state.nearest(lines)
    with_next, with_all = state.predicted_with([line]), state.predicted_with(lines)
    state.drive(line, _unmeasured)
    legs = tuple(state.legs[len(driven) :])
    return Advice(now, with_next, with_all, legs, False, likeliest.kernel, likeliest.unseen_m2)


def _unmeasured(xy: FloatArray) -> FloatArray:
    return np.full(len(xy), np.nan)


Event = dict[str, Any]
_SITE_MARGIN_M = 200.0
_NODES_ACROSS = 60


@dataclass
class SurveyWatch:
    """Watch over one rover's survey.

    `area`: what is to be mapped. `config`: requirement on the map, and errors of the samples. `legs`: planned
    legs in driving order; a swath that is advised is added when the rover is sent there. `every_m`: distance
    between updates of the map [m]. `grid_m`: step of the map [m]; a sixtieth of the longer side by default.
    The map reaches beyond the area by less than a step. `prior`: coarse elevations that the map is made with, whose cells
    `config` holds. `advice`: that of the last swath. `samples`: one for
    each step. `latest_map`: height and standard deviation (H, W) [m] on `grid` after the last update.
    """

    area: SurveyArea
    config: AdaptiveConfig
    legs: list[Leg]
    every_m: float = 25.0
    grid_m: float | None = None
    prior: Dem | None = None
    advice: Advice | None = None
    samples: list[Sample] = field(default_factory=list)
    latest_map: tuple[FloatArray, FloatArray] | None = None

    def __post_init__(self) -> None:
        west, south, east, north = self.area.bounds
        margin = _SITE_MARGIN_M
        self._gate = SampleGate((west - margin, south - margin, east + margin, north + margin))
        self.progress = LegProgress(self.legs, max(2.0, self.config.sample_step_m))
        self._warnings = RoverWarnings()
        self._mapped_m = 0.0
        step = self.grid_m or max(east - west, north - south) / _NODES_ACROSS
        self.grid = Grid.over((west, south, east, north), step, self.area.crs)

    def take(self, sample: Sample) -> list[Event]:
        """Take a sample, and return what it changes.

        Returns: events: ``refused``, ``warning``, ``swath``, ``advice``, ``map``.
        """
        reason = self._gate.reason(sample)
        if reason is not None:
            return [{"event": "refused", "time_s": sample.time_s, "reason": reason}]
        self._keep(sample)
        here = np.array([sample.x_m, sample.y_m])
        completed = self.progress.moved(here)
        waits = self.is_stopped or self.progress.n_driven == len(self.legs)
        events = self._warnings.of(sample, self.progress.driven_m, waits)
        if any(self.legs[index].kind == "swath" for index in completed):
            events += self._swath_done(sample.time_s)
        if self.advice is not None and self.progress.driven_m - self._mapped_m >= self.every_m:
            events.append(self._mapped(sample.time_s))
        return events

    def silent(self, time_s: float) -> list[Event]:
        """Take note that nothing arrived until a time.

        `time_s`: by the clock of the samples [s].
        """
        return self._warnings.silent(time_s)

    def send(self, legs: tuple[Leg, ...]) -> None:
        """Add the legs that the rover was sent along."""
        self.legs.extend(legs)

    @property
    def is_stopped(self) -> bool:
        """Whether the survey is over: the limit holds, or cannot be reached."""
        return self.advice is not None and not self.advice.legs

    @property
    def xyz(self) -> FloatArray:
        """Samples (N, 3) [m], one for each step."""
        return np.array([one[1:4] for one in self.samples])

    def map(self) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m] on the grid."""
        if self.advice is None:
            raise InputError("the covariance is fitted after the first swaths; drive on.")
        sigma = np.array([one.sigma_m for one in self.samples])
        noise = np.hypot(sigma, self.config.noise_m)
        nugget = float(np.sqrt(self.advice.unseen_m2))
        live = LiveMap(self.advice.kernel, nugget, self.grid, prior=self.prior)
        return live.of_samples(self.xyz, noise, self.config.shared_m)

    def _keep(self, sample: Sample) -> None:
        """Keep a sample that is a step from the one before."""
        if self.samples:
            last = self.samples[-1]
            if np.hypot(sample.x_m - last.x_m, sample.y_m - last.y_m) < self.config.sample_step_m:
                return
        self.samples.append(sample)

    def _swath_done(self, time_s: float) -> list[Event]:
        """Return that a swath is done, and what to do next once enough are."""
        n_swaths = sum(leg.kind == "swath" for leg in self.progress.driven)
        done: Event = {"event": "swath", "time_s": time_s, "swaths": n_swaths}
        if n_swaths < self.config.n_first:
            return [done]
        xyz = self.xyz
        self.advice = advised(self.area, self.progress.driven, xyz[:, :2], xyz[:, 2], self.config)
        return [done, _advice_event(time_s, self.advice, self.config), self._mapped(time_s)]

    def _mapped(self, time_s: float) -> Event:
        """Update the map; return its figures."""
        self._mapped_m = self.progress.driven_m
        _, std = self.latest_map = self.map()
        inside = self.area.contains(self.grid.xy).reshape(self.grid.shape)
        sigma = std[inside] if inside.any() else std.ravel()
        rmse = float(np.sqrt(np.mean(sigma**2)))
        return {
            "event": "map",
            "time_s": time_s,
            "driven_m": round(self.progress.driven_m, 1),
            "samples": len(self.samples),
            "expected_rmse_m": round(rmse, 4),
            "largest_sigma_m": round(float(sigma.max()), 4),
            "class": edition_2_class(rmse),
        }


def _advice_event(time_s: float, advice: Advice, config: AdaptiveConfig) -> Event:
    """Return what to do next as an event."""
    event: Event = {
        "event": "advice",
        "time_s": time_s,
        "limit_m": config.limit_m,
        "probability": round(advice.now.probability, 4),
        "rmse_m": round(advice.now.rmse_m, 4),
        "class": edition_2_class(advice.now.rmse_m),
        "do": "stop" if advice.is_met else "drive" if advice.legs else "give up",
    }
    if advice.with_next is not None and advice.with_all is not None:
        event["probability_with_next"] = round(advice.with_next.probability, 4)
        event["rmse_with_next_m"] = round(advice.with_next.rmse_m, 4)
        event["rmse_with_all_m"] = round(advice.with_all.rmse_m, 4)
        event["legs"] = [{"kind": leg.kind, "xy": leg.xy.round(3).tolist()} for leg in advice.legs]
    return event
