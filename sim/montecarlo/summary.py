"""Statistics of Monte Carlo trials: mean error, spread and pass share of every curve and size."""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc

from sim.montecarlo.config import StudyConfig
from sim.montecarlo.tables import read_trials
from survey.core.arrays import FloatArray
from survey.core.files.writing import replacing
from survey.core.streams import stream
from survey.core.text import csv_cell

_N_RESAMPLES = 1000
_WANTED_SHARE = 0.9
SummaryRow = dict[str, Any]


def summary(table: Path, study: StudyConfig) -> list[SummaryRow]:
    """Return one row for every terrain, planner, number of swaths and map, in the order of the study.

    Intervals hold 95 % of the values that resampled trials give (percentile bootstrap, Efron 1979).
    """
    columns = ["planner", "swaths", "map", "rmse_m", "length_m", "claimed_m", "silent_share"]
    rows = []
    everything = read_trials(table).select(["terrain", *columns])
    for kind in study.terrains:
        trials = everything.filter(pc.field("terrain") == kind.name)
        for design in study.designs:
            for how in study.maps:
                mine = trials.filter(
                    (pc.field("planner") == design.label)
                    & (pc.field("swaths") == design.swaths)
                    & (pc.field("map") == how.name)
                )
                values = {name: mine[name].to_numpy() for name in columns[3:]}
                head = {
                    "terrain": kind.name,
                    "planner": design.label,
                    "swaths": design.swaths,
                    "map": how.name,
                }
                rows.append({**head, **statistics(values, study.limit_m, tuple(map(str, head.values())))})
    return rows


def statistics(values: Mapping[str, FloatArray], limit_m: float, names: Sequence[str]) -> SummaryRow:
    """Return the statistics of one set of trials; `names` name the stream of its bootstrap."""
    rmse = values["rmse_m"]
    rng = stream(0, "bootstrap", *names)
    measures: dict[str, Callable[[FloatArray], FloatArray]] = {
        "mean_rmse_m": lambda x: x.mean(axis=-1),
        "p95_rmse_m": lambda x: np.percentile(x, 95.0, axis=-1),
        "pass_share": lambda x: (x <= limit_m).mean(axis=-1),
    }
    resampled: dict[str, list[FloatArray]] = {name: [] for name in measures}
    for _ in range(_N_RESAMPLES // 50):
        picked = rmse[rng.integers(len(rmse), size=(50, len(rmse)))]
        for name, measure in measures.items():
            resampled[name].append(measure(picked))
    row: SummaryRow = {"n": len(rmse), "mean_length_m": float(values["length_m"].mean())}
    for name, measure in measures.items():
        low, high = np.percentile(np.concatenate(resampled[name]), [2.5, 97.5])
        row |= {name: float(measure(rmse)), f"{name}_low": float(low), f"{name}_high": float(high)}
    row["median_rmse_m"] = float(np.median(rmse))
    row["pooled_rmse_m"] = float(np.sqrt(np.mean(rmse**2)))
    row["mean_claimed_m"] = float(values["claimed_m"].mean())
    row["silent_share"] = float(values["silent_share"].mean())
    return row


def minimum_swaths(rows: Sequence[SummaryRow], study: StudyConfig) -> list[SummaryRow]:
    """Return, for each curve, the fewest swaths whose mean error meets the class, and those whose trials do in 90 %.

    Empty where no number of swaths tried does.
    """
    result = []
    for curve, points in curves(rows).items():
        by_mean = [p["swaths"] for p in points if p["mean_rmse_m"] <= study.limit_m]
        by_share = [p["swaths"] for p in points if p["pass_share"] >= _WANTED_SHARE]
        result.append(
            {
                "terrain": curve[0],
                "planner": curve[1],
                "map": curve[2],
                "limit_m": study.limit_m,
                "fewest_by_mean": min(by_mean, default=None),
                "fewest_by_90_percent": min(by_share, default=None),
            }
        )
    return result


def curves(rows: Sequence[SummaryRow]) -> dict[tuple[str, str, str], list[SummaryRow]]:
    """Return the points of each curve, (terrain, planner, map), by rising number of swaths."""
    found: dict[tuple[str, str, str], list[SummaryRow]] = {}
    for row in rows:
        found.setdefault((row["terrain"], row["planner"], row["map"]), []).append(row)
    return {key: sorted(points, key=lambda point: point["swaths"]) for key, points in found.items()}


def write_rows(path: Path, rows: Sequence[SummaryRow]) -> None:
    """Write rows as CSV; numbers read back as they were, names are escaped, nothing stands for None."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {key: csv_cell(value) if isinstance(value, str) else value for key, value in row.items()}
            for row in rows
        )
