"""What the page shows of a plan: legs and numbers, the predicted error as an image, and the drive in time."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from shapely import Polygon

from desk.plan.document import PlanDocument
from desk.plan.live import LivePlan
from desk.plan.request import command_of
from desk.terrain.pyramid import ElevationPyramid, heights_at
from desk.terrain.shading import DEVIATION, colour_limit
from desk.terrain.tiles import picture
from firnline.actions.plan_texts import fact_texts
from firnline.actions.planning import AreaPlan
from planners.routes.rover import Rover, energy_per_metre
from planners.swaths.reference_lines import swaths_text
from survey import Dem, Route
from survey.core import BoolArray, FloatArray, IntArray
from survey.core.map_scale import ground_lengths_m


def plan_summary(live: LivePlan, document: PlanDocument, name: str, terrain: str) -> dict[str, Any]:
    """Return what the page shows of a plan."""
    route = live.plan.route
    texts = fact_texts(route.prediction)
    return {
        "is_provisional": live.is_provisional,
        "no_error_because": live.no_error_because,
        "has_error": live.plan.model is not None and "rmse_m" in route.prediction,
        "legs": [{"kind": leg.kind, "rover": leg.rover, "places": leg.xy.tolist()} for leg in route.legs],
        "n_rovers": route.n_rovers,
        "swaths": swaths_text(route),
        "spacing_m": route.spacing_m,
        "facts": [
            {"name": key, "title": title, "text": text, "value": route.prediction[key]}
            for key, (title, text) in texts.items()
        ],
        "area_m2": live.plan.area.ground_area_m2,
        "left_out": [
            {"rings": _rings(piece.polygon), "reason": piece.reason, "text": str(piece)}
            for piece in live.plan.left_out
        ],
        "command": command_of(document, f"{name}_area.gpkg", terrain, f"{name}.geojson"),
    }


def _rings(polygon: Polygon) -> list[list[list[float]]]:
    lines = [polygon.exterior, *polygon.interiors]
    return [[[float(x), float(y)] for x, y, *_ in line.coords[:-1]] for line in lines]


_COARSE_NODES_ALONG = 24
_COARSE_SAMPLES = 300


def error_layer(plan: AreaPlan, detail: str) -> dict[str, Any]:
    """Return the predicted standard deviation of a plan as an image with its place and legend.

    Returns: ``bounds`` [m], ``image`` (data address of a PNG), ``top_m`` of the colours, ``rmse_m``,
    ``p95_m``, ``worst_m``.
    """
    std = _coarse_std(plan) if detail == "coarse" else _fine_std(plan)
    if std is None:
        return {"bounds": list(plan.area.bounds), "image": None}
    return _std_picture(plan, std, colour_limit(std.elevation))


def _fine_std(plan: AreaPlan) -> Dem | None:
    return plan.drawing.std(plan.route, plan.drawing.fine_cell_m)


def _std_picture(plan: AreaPlan, std: Dem, top_m: float) -> dict[str, Any]:
    known = std.elevation[np.isfinite(std.elevation)]
    return {
        **picture(std, DEVIATION, 0.0, top_m),
        "top_m": top_m,
        "rmse_m": plan.route.prediction["rmse_m"],
        "p95_m": float(np.percentile(known, 95.0)),
        "worst_m": float(known.max()),
    }


_SHOWN = ("rmse_m", "length_m", "time_s", "energy_j", "n_turns", "n_recharges", "left_out_share")


def plans_beside(
    plan: LivePlan, other: LivePlan, document: PlanDocument, document_of_other: PlanDocument
) -> dict[str, Any]:
    """Return two plans side by side.

    Returns: ``rows`` of title, value of the plan, value of the other one and difference, all as text; the predicted
    errors ``error`` and ``error_of_other`` in the same colours, None where a plan predicts none; the ``lines`` of the
    other route.
    """
    facts, others = plan.plan.route.prediction, other.plan.route.prediction
    rows = [_fact_row(name, facts, others) for name in _SHOWN if name in facts and name in others]
    stds = [_fine_std(one.plan) for one in (plan, other)]
    known = [std for std in stds if std is not None]
    top_m = colour_limit(np.concatenate([std.elevation.ravel() for std in known])) if known else 0.0
    pictures = [
        None if std is None else _std_picture(one.plan, std, top_m)
        for one, std in zip((plan, other), stds, strict=True)
    ]
    return {
        "rows": [*rows, *_setting_rows(document, document_of_other)],
        "error": pictures[0],
        "error_of_other": pictures[1],
        "lines": [leg.xy.tolist() for leg in other.plan.route.legs],
    }


def _fact_row(name: str, facts: Mapping[str, float], others: Mapping[str, float]) -> list[str]:
    (title, text), (_, text_of_other) = fact_texts(facts)[name], fact_texts(others)[name]
    step = others[name] - facts[name]
    sign = "same" if step == 0 else ("+" if step > 0 else "−") + fact_texts({name: abs(step)})[name][1]
    short = [part.split(" of the ")[0].split(" (")[0] for part in (text, text_of_other, sign)]
    return [title, *short]


def _setting_rows(document: PlanDocument, other: PlanDocument) -> list[list[str]]:
    """Return the settings in which two documents differ."""
    rows = []
    for section in ("planner", "rover", "fleet"):
        values, others = getattr(document, section), getattr(other, section)
        for name in dict.fromkeys((*values, *others)):
            if values.get(name) != others.get(name):
                stated = ("–" if one.get(name) is None else str(one[name]) for one in (values, others))
                rows.append([name.replace("_", " "), *stated, ""])
    return rows


def _coarse_std(plan: AreaPlan) -> Dem | None:
    """Return the standard deviation on few nodes, from samples that are means of neighbours."""
    if plan.drawing.model is None:
        return None
    xmin, ymin, xmax, ymax = plan.area.bounds
    cell_m = max(xmax - xmin, ymax - ymin) / _COARSE_NODES_ALONG
    model = plan.drawing.model.for_comparisons().with_cells(cell_m)
    return model.error(plan.route, _COARSE_SAMPLES).std


_N_SAMPLES = 400
_TURN_RAD = np.radians(30.0)
"""A change of heading above this at a waypoint counts as a turn, as it does for the length and time of a plan."""


class RoverSamples(NamedTuple):
    """Places (N, 2) along the path of one rover, their heights, and the number of the leg of each."""

    rover: int
    xy: FloatArray
    heights: FloatArray
    leg: IntArray


class DriveSums(NamedTuple):
    """Sums along the path of one rover at its samples: distance [m], time [s], energy since the last depot [J]."""

    distance_m: FloatArray
    time_s: FloatArray
    energy_j: FloatArray


def drives(live: LivePlan, pyramid: ElevationPyramid) -> list[dict[str, Any]]:
    """Return the drive of each rover at about 400 samples.

    Returns: ``places``, ``heights_m`` (None where unknown), ``distance_m`` on the ground, ``time_s``,
    ``battery_share`` (None for an endless battery), ``energy_j``, and the first and last sample of each swath
    in ``swaths``.
    """
    return [_drive(live, rover, pyramid) for rover in range(live.plan.route.n_rovers)]


def _drive(live: LivePlan, rover: int, pyramid: ElevationPyramid) -> dict[str, Any]:
    route, mobility = live.plan.route, live.plan.rover
    xy, leg = _samples(route, rover)
    samples = RoverSamples(rover, xy, heights_at(pyramid, xy), leg)
    driven = _driven(route, samples, mobility)
    battery = None if mobility.battery_j is None else 1.0 - driven.energy_j / mobility.battery_j
    return {
        "rover": rover,
        "places": xy.round(2).tolist(),
        "heights_m": [None if np.isnan(height) else round(float(height), 2) for height in samples.heights],
        "distance_m": driven.distance_m.round(1).tolist(),
        "time_s": driven.time_s.round(1).tolist(),
        "energy_j": driven.energy_j.round(0).tolist(),
        "battery_share": None if battery is None else battery.clip(0.0).round(4).tolist(),
        "swaths": _swath_ranges(route, rover, leg),
    }


def _samples(route: Route, rover: int) -> tuple[FloatArray, IntArray]:
    """Return places (N, 2) along the legs of a rover, waypoints included, and the number of the leg of each."""
    legs = [(k, leg) for k, leg in enumerate(route.legs) if leg.rover == rover]
    step_m = max(sum(leg.length_m for _, leg in legs) / _N_SAMPLES, 1e-6)
    places, numbers = [], []
    for k, leg in legs:
        along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(leg.xy, axis=0).T))]
        at = np.union1d(along, np.linspace(0.0, along[-1], max(2, int(along[-1] / step_m) + 1)))
        places.append(np.column_stack([np.interp(at, along, leg.xy[:, axis]) for axis in (0, 1)]))
        numbers.append(np.full(len(at), k))
    return np.vstack(places), np.concatenate(numbers)


def _driven(route: Route, samples: RoverSamples, mobility: Rover) -> DriveSums:
    """Sum distance, time and energy along the samples of a rover."""
    run_m = ground_lengths_m(route.crs, samples.xy)
    rise_m = np.nan_to_num(np.diff(samples.heights))
    slant_m = np.hypot(run_m, rise_m)
    turning_s = np.where(_turns(samples.xy), mobility.turn_s, 0.0)
    energy_j = slant_m * energy_per_metre(np.arctan2(rise_m, run_m), mobility) + turning_s * mobility.idle_w
    charges = _charges(route, samples, mobility)
    seconds = np.r_[0.0, np.cumsum(slant_m / mobility.speed_m_s + turning_s)]
    waited_s = route.prediction.get(f"wait_s_rover_{samples.rover}", 0.0) + charges * mobility.recharge_s
    total_j = np.r_[0.0, np.cumsum(energy_j)]
    since_j = total_j - np.maximum.accumulate(np.where(np.diff(charges, prepend=0) > 0, total_j, 0.0))
    return DriveSums(np.r_[0.0, np.cumsum(run_m)], seconds + waited_s, since_j)


def _turns(xy: FloatArray) -> BoolArray:
    """Return for each step between samples whether a turn precedes it."""
    moves = np.diff(xy, axis=0)
    moving = np.flatnonzero(np.hypot(*moves.T) > 0.0)
    heading = np.arctan2(moves[moving, 1], moves[moving, 0])
    change = np.abs((np.diff(heading) + np.pi) % (2.0 * np.pi) - np.pi)
    turns = np.zeros(len(moves), dtype=bool)
    turns[moving[1:]] = change > _TURN_RAD
    return turns


def _charges(route: Route, samples: RoverSamples, mobility: Rover) -> IntArray:
    """Return for each sample how often the rover has been at its depot before, where it has a battery."""
    counts = np.zeros(len(samples.xy), dtype=np.int64)
    if mobility.battery_j is None:
        return counts
    begins = np.flatnonzero(np.diff(samples.leg, prepend=samples.leg[0]))
    ends = [route.legs[int(samples.leg[k - 1])].xy[-1] for k in begins]
    counts[[k for k, end in zip(begins, ends, strict=True) if np.array_equal(end, samples.xy[0])]] = 1
    return np.cumsum(counts)


def _swath_ranges(route: Route, rover: int, leg: IntArray) -> list[list[int]]:
    """Return the first and last sample of each swath of a rover."""
    found = []
    for k, one in enumerate(route.legs):
        if one.rover == rover and one.kind == "swath":
            samples = np.flatnonzero(leg == k)
            found.append([int(samples[0]), int(samples[-1])])
    return found
