"""Assessment of a map at checkpoints under named accuracy standards.

An `Assessment` is a finding under one standard. `assess` yields those of the vertical accuracy by the
formulas of each edition; `horizontal_findings` those of the horizontal and three-dimensional accuracy, where
checkpoints were found in the map as well. `score_at` computes error statistics and all findings. Where a
condition of a standard is not met there is no verdict.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from survey.core.errors import InputError
from survey.core.lengths import FOOT_M
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.standards.checkpoint_errors import (
    BLUNDER_FACTOR,
    CheckpointErrors,
    RmseInterval,
    Spread,
    cautions_of,
    datum_cautions,
    guidance_of,
    least_numbers,
    missing_accuracy,
    missing_cover,
    missing_in_general,
    missing_number,
)
from survey.scoring.standards.standards import (
    DIVISORS,
    EDITION_2,
    INTERVALS_FT,
    NSSDA,
    SMALLEST_RATIO,
    Standard,
    accuracy_r,
    accuracy_z,
    nva_limit_m,
    rmse_3d,
    rmse_h,
    rmse_v,
    standard_named,
    vva_limit_m,
)

Outcome = Literal["met", "not met", "reported", "not assessed to the standard"]
Kind = Literal["vertical", "horizontal", "3d"]
NOT_ASSESSED: Outcome = "not assessed to the standard"
_SHARE_BEYOND = 0.10
_INTERVALS_M = tuple(feet * FOOT_M for feet in INTERVALS_FT)
# The check survey of 1990 may err by a twentieth of the contour interval.
_CHECK_SURVEY_1990 = 20.0


@dataclass(frozen=True)
class Assessment:
    """One finding under one standard.

    `standard`, `edition`: name, title and year. `map_class`: the class asked for, e.g. ``"10 cm class"`` or
    ``"Class 1, interval 0.3048 m"``; empty where the standard has none. `measure`: what the value is.
    `value`: what was found: metres, or the share of points for NMAS. `limit`: what is allowed, in the same
    unit; ``None`` where the standard sets no limit. `outcome`: the last one whenever anything is `missing`;
    the value stands all the same. `n`: checkpoints behind the value. `checkpoint_rmse_m`: their own accuracy
    [m]. `spread`: how they lie. `missing`: conditions of the standard that are not met. `cautions`: what the
    standard, or good practice, asks to look at: bias, blunders, an unstated datum. `kind`: direction of the
    errors.
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


def assess(
    standard: Standard, errors: CheckpointErrors, class_m: float | None, interval_m: float | None
) -> Iterator[Assessment]:
    """Yield the findings under one standard."""
    intervals = _INTERVALS_M if interval_m is None else (interval_m,)
    if standard.measure == "rmse":
        for interval in intervals:
            for k in (1, 2, 3):
                yield _asprs_1990(standard, errors, interval, k)
    elif standard.measure == "share":
        for interval in intervals:
            yield _nmas(standard, errors, interval)
    elif standard.measure == "accuracy_95":
        yield _nssda_vertical(standard, errors)
    else:
        yield from _asprs_classes(standard, errors, class_m)


def _asprs_1990(standard: Standard, errors: CheckpointErrors, interval_m: float, k: int) -> Assessment:
    rmse, limit = rmse_of(errors), k * interval_m / DIVISORS[standard.name]
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


def _nssda_vertical(standard: Standard, errors: CheckpointErrors) -> Assessment:
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


@dataclass(frozen=True)
class CheckpointScore:
    """How good a map is at checkpoints.

    `elevation`: of map minus checkpoint. `interval`: 95 % interval of the RMSE. `assessments`: one or more
    for every standard that was asked for. `left_out`: checkpoints in the area where the map gives no height.
    `n_outside`: checkpoints outside the area.
    """

    elevation: ErrorStatistics
    interval: RmseInterval
    assessments: tuple[Assessment, ...]
    left_out: tuple[str, ...] = ()
    n_outside: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, with each finding's sentence.

        Returns: nested dictionaries and lists of plain values, ``None`` for NaN.
        """
        plain = asdict(self)
        for row, finding in zip(plain["assessments"], self.assessments, strict=True):
            row["sentence"] = finding.sentence
        result: dict[str, Any] = _finite(plain)
        return result


def score_at(
    errors: CheckpointErrors,
    standards: tuple[str, ...] = (EDITION_2,),
    *,
    class_m: float | None = None,
    interval_m: float | None = None,
    horizontal_class_m: float | None = None,
) -> CheckpointScore:
    """Judge a map by its errors at checkpoints.

    Parameters
    ----------
    errors : CheckpointErrors
        From `compare`.
    standards : tuple of str
        Names of `STANDARDS`.
    class_m : float, optional
        Class of the newer ASPRS standards: the RMSE wanted [m]. Without it their values are
        reported and nothing is met or missed.
    interval_m : float, optional
        Contour interval of ASPRS 1990 and NMAS [m]; 1, 2 and 3 ft by default.
    horizontal_class_m : float, optional
        Horizontal class of Edition 2: the RMSE_H wanted [m]. It needs checkpoints with `map_xy`; with a `class_m`
        beside it the three-dimensional class is the root of the sum of both squares.

    Returns
    -------
    CheckpointScore
        Error statistics, interval of the RMSE, and the assessments.

    Raises
    ------
    ConfigError
        A standard that is not known.
    InputError
        A class or an interval that is not positive, or a horizontal class without marks that were found in the map.

    Examples
    --------
    >>> import numpy as np
    >>> from survey.scoring.standards.checkpoint_errors import Spread
    >>> rng = np.random.default_rng(1)
    >>> here = Spread((0.25, 0.25, 0.25, 0.25), 0.1, 1e6)
    >>> def found(n):
    ...     names = tuple(str(k) for k in range(n))
    ...     return CheckpointErrors(rng.normal(0.0, 0.05, n), np.full(n, 0.02), np.zeros(n, bool), names, here)
    >>> [score_at(found(n), class_m=0.10).assessments[0].outcome for n in (29, 30)]
    ['not assessed to the standard', 'met']
    """
    wanted = ((class_m, "class"), (interval_m, "contour interval"), (horizontal_class_m, "horizontal class"))
    for value, what in wanted:
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"the {what} is {value} m; a number above 0 was expected.")
    findings: list[Assessment] = []
    for standard in map(standard_named, standards):
        findings += assess(standard, errors, class_m, interval_m)
        findings += horizontal_findings(standard, errors, horizontal_class_m, class_m)
    return CheckpointScore(
        ErrorStatistics.of(errors.errors_m),
        RmseInterval.of(errors.errors_m),
        tuple(findings),
        errors.left_out,
        errors.n_outside,
    )


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def horizontal_findings(
    standard: Standard, errors: CheckpointErrors, class_m: float | None, vertical_class_m: float | None
) -> Iterator[Assessment]:
    """Judge the horizontal errors by the NSSDA or by Edition 2, and the three-dimensional ones by the latter.

    Nothing is yielded for other standards, or where no checkpoint was found in the map.
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
        yield _nssda_horizontal(standard, placed)
    elif standard.name == EDITION_2:
        yield _radial(standard, placed, class_m)
        yield from _three_dimensional(standard, placed, class_m, vertical_class_m)


def _nssda_horizontal(standard: Standard, placed: CheckpointErrors) -> Assessment:
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
    """Return errors to investigate: a mean shift, and blunders."""
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
