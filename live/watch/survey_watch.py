"""State of a survey while it is driven: samples in, events out."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from live.watch.advice import Advice, advised
from live.watch.live_map import LiveMap
from live.watch.progress import LegProgress
from live.watch.sample import Sample, SampleGate
from live.watch.warnings import RoverWarnings
from planners.guarantee.adaptive_state import AdaptiveConfig
from planners.guarantee.requirement import reachable_class
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.grid import Grid
from survey.data.route import Leg

Event = dict[str, Any]
_SITE_MARGIN_M = 200.0
_NODES_ACROSS = 60


@dataclass
class SurveyWatch:
    """Watch over one rover's survey.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    config : AdaptiveConfig
        Requirement on the map, and errors of the samples.
    legs : list of Leg
        Planned legs in driving order; a swath that is advised is added when the rover is sent there.
    every_m : float
        Distance between updates of the map [m].
    grid_m : float, optional
        Step of the map [m]; a sixtieth of the longer side by default. The map reaches beyond the area by less
        than a step.
    advice : Advice, optional
        That of the last swath.
    samples : list of Sample
        One for each step.
    latest_map : tuple of ndarray, optional
        Height and standard deviation (H, W) [m] on `grid` after the last update.
    """

    area: SurveyArea
    config: AdaptiveConfig
    legs: list[Leg]
    every_m: float = 25.0
    grid_m: float | None = None
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

        Parameters
        ----------
        sample : Sample
            The next one.

        Returns
        -------
        list of dict
            Events: ``refused``, ``warning``, ``swath``, ``advice``, ``map``.
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

        Parameters
        ----------
        time_s : float
            By the clock of the samples [s].

        Returns
        -------
        list of dict
            A warning, once.
        """
        return self._warnings.silent(time_s)

    def send(self, legs: tuple[Leg, ...]) -> None:
        """Add the legs that the rover was sent along.

        Parameters
        ----------
        legs : tuple of Leg
            Of an advice.
        """
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
        """Return height and standard deviation (H, W) [m] on the grid.

        Returns
        -------
        tuple of ndarray
            From all samples so far.

        Raises
        ------
        InputError
            Before the first advice, which fits the covariance.
        """
        if self.advice is None:
            raise InputError("the covariance is fitted after the first swaths; drive on.")
        sigma = np.array([one.sigma_m for one in self.samples])
        noise = np.hypot(sigma, self.config.noise_m)
        nugget = float(np.sqrt(self.advice.unseen_m2))
        live = LiveMap(self.advice.kernel, nugget, self.grid)
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
            "class": reachable_class(rmse),
        }


def _advice_event(time_s: float, advice: Advice, config: AdaptiveConfig) -> Event:
    """Return what to do next as an event."""
    event: Event = {
        "event": "advice",
        "time_s": time_s,
        "limit_m": config.limit_m,
        "probability": round(advice.now.probability, 4),
        "rmse_m": round(advice.now.rmse_m, 4),
        "class": reachable_class(advice.now.rmse_m),
        "do": "stop" if advice.is_met else "drive" if advice.legs else "give up",
    }
    if advice.with_next is not None and advice.with_all is not None:
        event["probability_with_next"] = round(advice.with_next.probability, 4)
        event["rmse_with_next_m"] = round(advice.with_next.rmse_m, 4)
        event["rmse_with_all_m"] = round(advice.with_all.rmse_m, 4)
        event["legs"] = [{"kind": leg.kind, "xy": leg.xy.round(3).tolist()} for leg in advice.legs]
    return event
