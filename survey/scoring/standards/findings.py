"""Findings on checkpoints under each accuracy standard."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from survey.core.errors import InputError
from survey.scoring.standards.checkpoint_errors import CheckpointErrors, Spread
from survey.scoring.standards.conditions import (
    cautions_of,
    datum_cautions,
    guidance_of,
    least_numbers,
    missing_accuracy,
    missing_cover,
    missing_in_general,
    missing_number,
)
from survey.scoring.standards.formulas import (
    accuracy_z,
    nva_limit_m,
    rmse_v,
    vva_limit_m,
)
from survey.scoring.standards.standards import (
    CONTOURS,
    EDITION_2,
    FOOT_M,
    SPOT_HEIGHTS,
    Standard,
)

Outcome = Literal["met", "not met", "reported", "not assessed to the standard"]
Kind = Literal["vertical", "horizontal", "3d"]
NOT_ASSESSED: Outcome = "not assessed to the standard"
_SHARE_BEYOND = 0.10
_DIVISORS = {SPOT_HEIGHTS: 6.0, CONTOURS: 3.0}
_INTERVALS_M = (FOOT_M, 2 * FOOT_M, 3 * FOOT_M)
# The check survey of 1990 may err by a twentieth of the contour interval.
_CHECK_SURVEY_1990 = 20.0


@dataclass(frozen=True)
class Assessment:
    """One finding under one standard.

    Parameters
    ----------
    standard, edition : str
        Name, title and year.
    map_class : str
        The class asked for, e.g. ``"10 cm class"`` or ``"Class 1, interval 0.3048 m"``; empty where
        the standard has none.
    measure : str
        What the value is.
    value : float
        What was found: metres, or the share of points for NMAS.
    limit : float or None
        What is allowed, in the same unit; ``None`` where the standard sets no limit.
    outcome : {"met", "not met", "reported", "not assessed to the standard"}
        The last one whenever anything is `missing`; the value stands all the same.
    n : int
        Checkpoints behind the value.
    checkpoint_rmse_m : float
        Their own accuracy [m].
    spread : Spread
        How they lie.
    missing : tuple of str
        Conditions of the standard that are not met.
    cautions : tuple of str
        What the standard, or good practice, asks to look at: bias, blunders, an unstated datum.
    kind : {"vertical", "horizontal", "3d"}
        Direction of the errors.
    """

    standard: str
    edition: str
    map_class: str
    measure: str
    value: float
    limit: float | None
    outcome: Outcome
    n: int
    checkpoint_rmse_m: float
    spread: Spread
    missing: tuple[str, ...] = ()
    cautions: tuple[str, ...] = ()
    kind: Kind = "vertical"

    @property
    def is_vegetated(self) -> bool:
        """Whether it is on vegetated ground, of which Edition 2 reports the accuracy without a limit."""
        return self.measure.startswith("vegetated") or self.measure.endswith("on vegetated ground")

    @property
    def sentence(self) -> str:
        """The finding in words: edition, class, value beside limit, number of points, what is missing."""
        unit = "" if self.measure.startswith("share") else " m"
        limit = "" if self.limit is None else f", limit {self.limit:.4g}{unit}"
        asked = f", {self.map_class}" if self.map_class else ""
        facts = (
            f"{self.edition}{asked}: {self.outcome}; {self.measure} {self.value:.4g}{unit}{limit}, "
            f"{self.n} checkpoints accurate to {self.checkpoint_rmse_m:.3g} m"
        )
        return facts + ("; missing: " + "; ".join(self.missing) if self.missing else "") + "."


def assessed(
    standard: Standard, errors: CheckpointErrors, class_m: float | None, interval_m: float | None
) -> Iterator[Assessment]:
    """Take the standard's way of judging."""
    intervals = _INTERVALS_M if interval_m is None else (interval_m,)
    if standard.measure == "rmse":
        for interval in intervals:
            for k in (1, 2, 3):
                yield _asprs_1990(standard, errors, interval, k)
    elif standard.measure == "share":
        for interval in intervals:
            yield _nmas(standard, errors, interval)
    elif standard.measure == "accuracy_95":
        yield _nssda(standard, errors)
    else:
        yield from _asprs_classes(standard, errors, class_m)


def _asprs_1990(standard: Standard, errors: CheckpointErrors, interval_m: float, k: int) -> Assessment:
    rmse, limit = rmse_of(errors), k * interval_m / _DIVISORS[standard.name]
    missing = missing_in_general(standard, errors)
    if errors.checkpoint_rmse_m > interval_m / _CHECK_SURVEY_1990:
        missing.append(
            f"checkpoints accurate to {interval_m / _CHECK_SURVEY_1990:.3g} m (a twentieth of the interval), not {errors.checkpoint_rmse_m:.3g} m"
        )
    cautions = cautions_of(standard, errors, limit)
    label = f"Class {k}, interval {interval_m:.4g} m"
    return finding_of(standard, errors, (label, "RMSE", rmse, limit), missing, cautions)


def _nmas(standard: Standard, errors: CheckpointErrors, interval_m: float) -> Assessment:
    """Count the points beyond half an interval; no horizontal shift is granted."""
    share = float(np.mean(np.abs(errors.errors_m) > 0.5 * interval_m))
    cautions = [
        *datum_cautions(errors),
        "the allowance for a horizontal shift within the map's tolerance is not used",
    ]
    label = f"contour interval {interval_m:.4g} m"
    measure = "share of points off by more than half the interval:"
    missing = missing_in_general(standard, errors)
    return finding_of(standard, errors, (label, measure, share, _SHARE_BEYOND), missing, cautions)


def _nssda(standard: Standard, errors: CheckpointErrors) -> Assessment:
    value = accuracy_z(rmse_of(errors))
    cautions = [*datum_cautions(errors), "the standard sets no limit: the accuracy is stated, not passed"]
    return finding_of(
        standard,
        errors,
        ("", "tested accuracy at 95 %", value, None),
        missing_in_general(standard, errors),
        cautions,
    )


def _asprs_classes(
    standard: Standard, errors: CheckpointErrors, class_m: float | None
) -> Iterator[Assessment]:
    """Judge open ground by the class, vegetated ground as the edition has it."""
    n_open, n_vegetated = least_numbers(standard, errors.spread.area_m2 / 1e6)
    open_, vegetated = errors.on(vegetated=False), errors.on(vegetated=True)
    label = "" if class_m is None else f"{class_m * 100.0:g} cm class"
    if open_ is None:
        raise InputError(
            "all checkpoints lie on vegetated ground; the class of a map is judged on open ground."
        )
    edition_2 = standard.name == EDITION_2
    value = rmse_v(rmse_of(open_), open_.checkpoint_rmse_m) if edition_2 else accuracy_z(rmse_of(open_))
    limit = None if class_m is None else class_m if edition_2 else nva_limit_m(class_m)
    measure = "non-vegetated RMSE_V" if edition_2 else "non-vegetated accuracy at 95 %"
    missing = [*missing_number(standard, open_, n_open, "open"), *missing_accuracy(standard, open_, class_m)]
    cautions = cautions_of(standard, open_, class_m)
    yield finding_of(standard, open_, (label, measure, value, limit), missing, cautions)
    if vegetated is None:
        return
    missing = [
        *missing_number(standard, vegetated, n_vegetated, "vegetated"),
        *missing_accuracy(standard, vegetated, class_m),
    ]
    if edition_2:
        value, limit, measure = (
            rmse_v(rmse_of(vegetated), vegetated.checkpoint_rmse_m),
            None,
            "vegetated RMSE_V",
        )
    else:
        value = float(np.percentile(np.abs(vegetated.errors_m), 95.0))
        limit = None if class_m is None else vva_limit_m(class_m)
        measure = "vegetated 95th percentile"
    yield finding_of(standard, vegetated, (label, measure, value, limit), missing, datum_cautions(vegetated))


def finding_of(
    standard: Standard,
    errors: CheckpointErrors,
    asked: tuple[str, str, float, float | None],
    missing: list[str],
    cautions: list[str],
    *,
    kind: Kind = "vertical",
) -> Assessment:
    """Compare the value with the limit of what was asked (class, measure, value, limit), unless conditions are missing."""
    label, measure, value, limit = asked
    missing = [*missing, *missing_cover(errors)]
    outcome: Outcome = NOT_ASSESSED
    if not missing:
        outcome = "reported" if limit is None else "met" if value <= limit else "not met"
    return Assessment(
        standard.name,
        standard.edition,
        label,
        measure,
        value,
        limit,
        outcome,
        len(errors.errors_m),
        errors.checkpoint_rmse_m,
        errors.spread,
        tuple(missing),
        (*cautions, *guidance_of(standard, errors)),
        kind,
    )


def rmse_of(errors: CheckpointErrors) -> float:
    """Return the root mean square of the errors of height [m]."""
    return float(np.sqrt(np.mean(errors.errors_m**2)))
