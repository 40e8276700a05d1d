"""Log of a watch: JSON lines of what arrived and what it changed, which replay to the same bytes.

The first line states the survey: area, requirement, planned legs, and the prior where there is one. Lines with ``in`` are inputs: a sample, a silence, legs
that the rover was sent along. All others follow from them.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from affine import Affine

from live.watch.samples import Sample
from live.watch.survey_watch import Event, SurveyWatch
from planners.guarantee.adaptive import AdaptiveConfig
from planners.prediction.prior_cells import PriorCells
from survey import Dem, InputError, Leg, SurveyArea
from survey.core import parse_json, refusing_damage

VERSION = 1


def line_of(entry: dict[str, Any]) -> str:
    r"""Return an entry as a line of the log.

    >>> line_of({"in": "silence", "time_s": 31.5})
    '{"in":"silence","time_s":31.5}\n'
    """
    return json.dumps(entry, separators=(",", ":"), ensure_ascii=False, allow_nan=False) + "\n"


def watch_header(watch: SurveyWatch) -> dict[str, Any]:
    """Return the first line of a log: everything that a replay needs."""
    cells, prior = watch.config.cells, watch.prior
    stated = {} if cells is None or prior is None else {"prior": _prior_as_lists(prior, cells.sigma_m)}
    return {
        "firnline_watch": VERSION,
        "crs": watch.area.crs.to_wkt(),
        "area": shapely.to_wkt(watch.area.polygon, rounding_precision=-1),
        "no_go": [shapely.to_wkt(zone, rounding_precision=-1) for zone in watch.area.no_go],
        "requirement": asdict(replace(watch.config, cells=None)),
        "every_m": watch.every_m,
        "grid_m": watch.grid_m,
        "legs": legs_as_lists(watch.legs),
        **stated,
    }


def _prior_as_lists(prior: Dem, sigma_m: float) -> dict[str, Any]:
    """Return a prior as lists of numbers, None where a cell is unknown, with the deviation of a cell [m]."""
    heights = [[z if np.isfinite(z) else None for z in row] for row in prior.elevation.tolist()]
    return {"sigma_m": sigma_m, "transform": list(prior.transform)[:6], "elevation_m": heights}


def watch_of(heading: dict[str, Any]) -> SurveyWatch:
    """Return the watch that a first line states."""
    zones = tuple(shapely.from_wkt(text) for text in heading["no_go"])
    area = SurveyArea(shapely.from_wkt(heading["area"]), heading["crs"], zones)
    config, prior = AdaptiveConfig(**heading["requirement"]), None
    if stated := heading.get("prior"):
        prior = Dem(np.array(stated["elevation_m"], dtype=float), Affine(*stated["transform"]), area.crs)
        config = replace(config, cells=PriorCells.of(prior, area, stated["sigma_m"]))
    return SurveyWatch(area, config, legs_of(heading["legs"]), heading["every_m"], heading["grid_m"], prior)


def legs_as_lists(legs: list[Leg]) -> list[dict[str, Any]]:
    """Return legs as lists of numbers."""
    return [{"kind": leg.kind, "xy": leg.xy.tolist(), "axis": np.asarray(leg.axis).tolist()} for leg in legs]


def legs_of(entries: list[dict[str, Any]]) -> list[Leg]:
    """Return the legs that `legs_as_lists` wrote."""
    return [Leg(one["kind"], np.array(one["xy"]), 0, np.array(one["axis"])) for one in entries]


def entered(watch: SurveyWatch, entry: dict[str, Any]) -> list[Event]:
    """Give an input to a watch, and return the events that follow."""
    if entry["in"] == "sample":
        return watch.take(Sample(*entry["sample"]))
    if entry["in"] == "silence":
        return watch.silent(entry["time_s"])
    watch.send(tuple(legs_of(entry["legs"])))
    return []


def replayed(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the entries of a log, those that follow from inputs computed again."""
    for _, entry in replayed_states(path):
        yield entry


def replayed_states(path: Path) -> Iterator[tuple[SurveyWatch, dict[str, Any]]]:
    """Yield the entries of a log as `replayed` does, each with the state of the survey."""
    heading, *entries = _lines(path)
    watch = _watch_of_file(path, heading)
    yield watch, heading
    for number, entry in enumerate(entries, 2):
        if "in" not in entry:
            continue
        yield watch, entry
        with refusing_damage(f"{path}, line {number},", "input of a watch", "name another file"):
            events = entered(watch, entry)
        for event in events:
            yield watch, event


def _lines(path: Path) -> list[dict[str, Any]]:
    """Read the complete lines of a log: one object each, the first one the heading."""
    entries: list[dict[str, Any]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").split("\n")[:-1], 1):
        entry = parse_json(line, f"{path}, line {number}", "name a log of firnline watch")
        if not isinstance(entry, dict):
            raise InputError(f"{path}, line {number}: no JSON object; name a log of firnline watch.")
        entries.append(entry)
    if not entries:
        raise InputError(f"{path} has no complete line; name a log of firnline watch.")
    return entries


def _watch_of_file(path: Path, heading: dict[str, Any]) -> SurveyWatch:
    """Return the watch that the first line of a file states."""
    if heading.get("firnline_watch") != VERSION:
        raise InputError(
            f"{path}, line 1: 'firnline_watch': {VERSION} was expected; name a log of firnline watch of this version."
        )
    with refusing_damage(f"{path}, line 1,", "survey", "name another file"):
        return watch_of(heading)
