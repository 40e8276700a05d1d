"""Conditions that the accuracy standards set on checkpoints, and what they ask to investigate."""

import numpy as np

from survey.scoring.standards.checkpoint_errors import CheckpointErrors
from survey.scoring.standards.formulas import (
    checkpoints_2014,
    checkpoints_edition_2,
)
from survey.scoring.standards.standards import ASPRS_2014, FOOT_M, LEAST_COVERED, Standard

BLUNDER_FACTOR = 3.0
"""Errors beyond this many times the limit of the RMSE are to be investigated."""


_NO_DATUM = (
    "the map or the checkpoints do not state their vertical datum; datums can differ by tens of metres"
)
# Blunders: so many times the error that this share of at least so many checkpoints stays below; the worst are named.
_TIMES_USUAL, _USUAL_SHARE, _LEAST_CHECKPOINTS, _N_NAMED = 10.0, 0.8, 10, 5
# Heights in feet: their ratio to those of the map, to this share, where they are not near sea level.
_FEET_TOLERANCE, _LEAST_FEET = 0.01, 300.0
# Shares and spacings are compared with a hair of slack, so that 20 % of 30 points may be 6 of 30.
_SLACK = 1e-9


def missing_cover(errors: CheckpointErrors) -> list[str]:
    """Return what the map misses of the area."""
    if errors.covered_share >= LEAST_COVERED:
        return []
    return [f"heights on {LEAST_COVERED:.1%} of the area (the map covers {errors.covered_share:.1%})"]


def least_numbers(standard: Standard, area_km2: float) -> tuple[int, int]:
    """Return the least numbers of checkpoints on open and on vegetated ground."""
    if standard.name == ASPRS_2014:
        return checkpoints_2014(area_km2)
    n = checkpoints_edition_2(area_km2)
    return n, n


def missing_number(standard: Standard, errors: CheckpointErrors, n_least: int, ground: str) -> list[str]:
    """Return a condition where there are too few checkpoints."""
    n = len(errors.errors_m)
    if n >= n_least:
        return []
    return [f"{n_least} checkpoints on {ground} ground (there are {n}){_mark(standard, 'n_least')}"]


def missing_accuracy(standard: Standard, errors: CheckpointErrors, class_m: float | None) -> list[str]:
    """Compare the checkpoints' accuracy with what the class asks of them."""
    if class_m is None or standard.sharper is None:
        return []
    needed = class_m / standard.sharper
    if errors.checkpoint_rmse_m <= needed * (1.0 + _SLACK):
        return []
    return [
        f"checkpoints accurate to {needed:.3g} m ({standard.sharper:g} times better than the class), not {errors.checkpoint_rmse_m:.3g} m"
    ]


def missing_in_general(standard: Standard, errors: CheckpointErrors) -> list[str]:
    """Return what the standard misses in the number of checkpoints."""
    return [] if standard.n_least is None else missing_number(standard, errors, standard.n_least, "any")


def guidance_of(standard: Standard, errors: CheckpointErrors) -> list[str]:
    """Return where the checkpoints are spread less evenly than the standard advises; that is no condition.

    The NSSDA says how points *may* be distributed over a rectangular area of uniform accuracy (appendix 3-C).
    """
    advised = []
    share, spacing = standard.quadrant_share, standard.spacing_share
    found = min(errors.spread.quadrant_shares)
    if share is not None and found < share - _SLACK:
        advised.append(
            f"guidance: {share:.0%} of the checkpoints in every quarter of the area (one has {found:.0%}){_mark(standard, 'quadrant_share')}"
        )
    apart = errors.spread.spacing_share
    if spacing is not None and apart < spacing - _SLACK:
        advised.append(
            f"guidance: {spacing:.0%} of the diagonal between any two checkpoints (two are {apart:.1%} apart){_mark(standard, 'spacing_share')}"
        )
    return advised


def cautions_of(standard: Standard, errors: CheckpointErrors, limit_m: float | None) -> list[str]:
    """Return what is to be investigated: a bias, blunders, a datum that is not stated."""
    found = datum_cautions(errors)
    if limit_m is None:
        return found
    bias = abs(float(np.mean(errors.errors_m)))
    if standard.bias_share is not None and bias > standard.bias_share * limit_m:
        found.append(
            f"the mean error {bias:.3g} m exceeds {standard.bias_share:.0%} of the class: investigate{_mark(standard, 'bias_share')}"
        )
    blunders = errors.beyond(BLUNDER_FACTOR * limit_m)
    if blunders:
        found.append(
            f"errors beyond {BLUNDER_FACTOR:g} times the limit at {', '.join(blunders)}: investigate, they are in the figures{_mark(standard, 'blunders')}"
        )
    return found


def datum_cautions(errors: CheckpointErrors) -> list[str]:
    """Return cautions where a vertical datum is not stated, and where heights are in feet or a few are blunders."""
    if _are_feet(errors):
        return [
            "the heights of the checkpoints are 3.28 times those of the map, as feet are; convert them to metres"
        ]
    stated = [] if errors.has_datums else [_NO_DATUM]
    return stated + _blunder_cautions(errors)


def _are_feet(errors: CheckpointErrors) -> bool:
    if errors.xyz is None or not len(errors.errors_m) or errors.xyz[:, 2].min() <= 0.0:
        return False
    height = errors.xyz[:, 2]
    ratio = float(np.median((height + errors.errors_m) / height)) / FOOT_M
    return bool(abs(ratio - 1.0) < _FEET_TOLERANCE and np.median(height) > _LEAST_FEET)


def _blunder_cautions(errors: CheckpointErrors) -> list[str]:
    """Return a caution where few checkpoints err by far more than all others; none is left out for its error."""
    n = len(errors.errors_m)
    size_m = np.abs(errors.errors_m - np.median(errors.errors_m))
    usual_m = (
        max(float(np.quantile(size_m, _USUAL_SHARE)), float(np.median(errors.sigma_z_m))) if n else np.inf
    )
    rows = np.flatnonzero(size_m > _TIMES_USUAL * usual_m)
    if n < _LEAST_CHECKPOINTS or not len(rows):
        return []
    worst = rows[np.argsort(-size_m[rows], kind="stable")][:_N_NAMED]
    named = ", ".join(f"{errors.names[row]} ({errors.errors_m[row]:+.2f} m)" for row in worst)
    return [
        f"{len(rows)} of {n} checkpoints err by more than {_TIMES_USUAL:g} times as much as most others, and the statistics hang on "
        f"them: {named}; check whether they are blunders"
    ]


def _mark(standard: Standard, what: str) -> str:
    return " (unverified)" if what in standard.unverified else ""
