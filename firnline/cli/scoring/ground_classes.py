"""Error statistics by class of slope and of land cover."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from firnline.cli.scoring.request import SLOPE, ScoreRequest

if TYPE_CHECKING:
    from survey import Dem
    from survey.core.arrays import FloatArray
    from survey.scoring.class_scores import ClassScore

Classes = dict[str, tuple["ClassScore", ...]]


def scores_by_class(
    request: ScoreRequest, errors: "FloatArray", std: "FloatArray", xy: "FloatArray", surface: "Dem"
) -> Classes:
    """Return error statistics by each classification that was asked for.

    `surface` gives the slopes: the reference where there is one, else the map.
    """
    from survey.scoring.class_scores import class_scores, land_cover_at, slope_classes

    found: Classes = {}
    for by in request.by:
        if by == SLOPE:
            names = slope_classes(surface.slope().at(xy))
        else:
            names = land_cover_at(by, xy, surface.crs, request.class_column)
        found[_name_of(by)] = class_scores(errors, std, names)
    return found


def _name_of(by: str) -> str:
    return by if by == SLOPE else Path(by).stem


def class_lines(classes: Classes) -> list[str]:
    """Return the tables of classes as text."""
    lines = []
    for name, rows in classes.items():
        width = max(len(name), *(len(row.name) for row in rows)) + 2
        lines.append(f"{name:<{width}}{'n':>8}{'RMSE':>9}{'NMAD':>9}{'bias':>9}{'in 95 %':>9}")
        lines += [
            f"{row.name:<{width}}{row.n:>8}{row.rmse_m:>9.3f}{row.nmad_m:>9.3f}{row.bias_m:>+9.3f}"
            + (f"{row.coverage_95:>9.1%}" if math.isfinite(row.coverage_95) else f"{'–':>9}")
            for row in rows
        ]
    return lines


def class_values(classes: Classes) -> dict[str, list[dict[str, object]]]:
    """Return the tables of classes as plain values for JSON."""
    from dataclasses import asdict

    return {
        name: [{key: _plain(value) for key, value in asdict(row).items()} for row in rows]
        for name, rows in classes.items()
    }


def _plain(value: object) -> object:
    """Return a value for JSON, None for NaN."""
    return None if isinstance(value, float) and math.isnan(value) else value
