"""Horizontal and three-dimensional accuracy at checkpoints that were found in the map as well."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from survey.core.errors import InputError
from survey.scoring.standards.checkpoint_errors import CheckpointErrors
from survey.scoring.standards.conditions import BLUNDER_FACTOR, least_numbers, missing_number
from survey.scoring.standards.findings import NOT_ASSESSED, Assessment, finding_of, rmse_of
from survey.scoring.standards.formulas import SMALLEST_RATIO, accuracy_r, rmse_3d, rmse_h, rmse_v
from survey.scoring.standards.standards import EDITION_2, NSSDA, Standard


def horizontal_findings(
    standard: Standard, errors: CheckpointErrors, class_m: float | None, vertical_class_m: float | None
) -> Iterator[Assessment]:
    """Judge the horizontal errors by the NSSDA or by Edition 2, and the three-dimensional ones by the latter.

    Nothing is yielded for other standards, or where no checkpoint was found in the map.

    Raises
    ------
    InputError
        A horizontal class, and no checkpoint that was found in the map.
    """
    placed = errors.placed
    if placed is None:
        if class_m is not None:
            raise InputError(
                "a horizontal class was asked for, and no checkpoint states where it was found in the map; add the "
                "columns map_x_m and map_y_m."
            )
        return
    if standard.name == NSSDA:
        yield _nssda(standard, placed)
    elif standard.name == EDITION_2:
        yield _radial(standard, placed, class_m)
        yield from _three_dimensional(standard, placed, class_m, vertical_class_m)


def _nssda(standard: Standard, placed: CheckpointErrors) -> Assessment:
    """State the radial accuracy at 95 %; none where the axes differ too much for the standard's formula."""
    x, y = _axes(placed)
    value = accuracy_r(x, y)
    missing = missing_number(standard, placed, standard.n_least or 0, "any")
    cautions = ["the standard sets no limit: the accuracy is stated, not passed"]
    if value is not None:
        asked = ("", "tested horizontal accuracy at 95 %", value, None)
        return finding_of(standard, placed, asked, missing, cautions, kind="horizontal")
    missing.append(
        f"errors east and north of a ratio above {SMALLEST_RATIO:g} (RMSE_x {x:.3g} m, RMSE_y {y:.3g} m)"
    )
    asked = ("", "horizontal RMSE_r", math.hypot(x, y), None)
    found = finding_of(standard, placed, asked, missing, cautions, kind="horizontal")
    return replace(found, outcome=NOT_ASSESSED)


def _radial(standard: Standard, placed: CheckpointErrors, class_m: float | None) -> Assessment:
    asked = (_label(class_m), "horizontal RMSE_H", _rmse_h(placed), class_m)
    return finding_of(
        standard,
        placed,
        asked,
        _missing(standard, placed, class_m),
        _cautions(standard, placed, class_m),
        kind="horizontal",
    )


def _three_dimensional(
    standard: Standard, placed: CheckpointErrors, class_m: float | None, vertical_class_m: float | None
) -> Iterator[Assessment]:
    """Yield the accuracy in space on open ground, judged by both classes together, and on vegetated ground."""
    wanted = None if class_m is None or vertical_class_m is None else math.hypot(class_m, vertical_class_m)
    for is_vegetated in (False, True):
        on = placed.on(vegetated=is_vegetated)
        if on is None:
            continue
        value = rmse_3d(_rmse_h(on), rmse_v(rmse_of(on), on.checkpoint_rmse_m))
        ground = "vegetated" if is_vegetated else "non-vegetated"
        limit = None if is_vegetated else wanted
        asked = (_label(wanted), f"three-dimensional RMSE_3D on {ground} ground", value, limit)
        yield finding_of(standard, on, asked, _missing(standard, on, class_m), [], kind="3d")


def _missing(standard: Standard, placed: CheckpointErrors, class_m: float | None) -> list[str]:
    """Return which conditions on number and accuracy of the checkpoints are not met."""
    n_least, _ = least_numbers(standard, placed.spread.area_m2 / 1e6)
    missing = missing_number(standard, placed, n_least, "any")
    if (
        class_m is not None
        and standard.sharper is not None
        and _survey_m(placed) > class_m / standard.sharper
    ):
        missing.append(
            f"checkpoints placed to {class_m / standard.sharper:.3g} m ({standard.sharper:g} times better than the "
            f"class), not {_survey_m(placed):.3g} m"
        )
    return missing


def _cautions(standard: Standard, placed: CheckpointErrors, class_m: float | None) -> list[str]:
    """Return what is to be investigated: a mean shift, and blunders."""
    if class_m is None or placed.shift_m is None:
        return []
    found = []
    bias = float(np.abs(placed.shift_m.mean(axis=0)).max())
    if standard.bias_share is not None and bias > standard.bias_share * class_m:
        found.append(
            f"the mean shift {bias:.3g} m exceeds {standard.bias_share:.0%} of the class: investigate"
        )
    far = np.abs(placed.shift_m).max(axis=1) > BLUNDER_FACTOR * class_m
    if far.any():
        names = ", ".join(placed.names[k] for k in np.flatnonzero(far))
        found.append(
            f"shifts beyond {BLUNDER_FACTOR:g} times the class at {names}: investigate, they are in the figures"
        )
    return found


def _rmse_h(placed: CheckpointErrors) -> float:
    return rmse_h(*_axes(placed), _survey_m(placed) / math.sqrt(2.0))


def _axes(placed: CheckpointErrors) -> tuple[float, float]:
    """Return the root mean square errors east and north [m]."""
    assert placed.shift_m is not None
    x, y = np.sqrt(np.mean(placed.shift_m**2, axis=0)).tolist()
    return x, y


def _survey_m(placed: CheckpointErrors) -> float:
    """Return the root mean square of the checkpoints' own horizontal standard deviations [m]."""
    assert placed.sigma_xy_m is not None
    return float(np.sqrt(np.mean(placed.sigma_xy_m**2)))


def _label(class_m: float | None) -> str:
    return "" if class_m is None else f"{class_m * 100.0:.4g} cm class"
