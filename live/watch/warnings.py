"""Warnings about the rover: stuck, silent, or short of charge for the way home."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from live.watch.sample import Sample

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
