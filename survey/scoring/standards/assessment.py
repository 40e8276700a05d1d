"""Assess checkpoints under a named accuracy standard; no verdict where its conditions are not met."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from survey.core.errors import InputError
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.standards.checkpoint_errors import CheckpointErrors, Spread
from survey.scoring.standards.conditions import (
    cautions_of,
    datum_cautions,
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
from survey.scoring.standards.intervals import RmseInterval
from survey.scoring.standards.standards import (
    CONTOURS,
    EDITION_2,
    FOOT_M,
    SPOT_HEIGHTS,
    Standard,
    standard_named,
)

Outcome = Literal["met", "not met", "reported", "not assessed to the standard"]
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


@dataclass(frozen=True)
class CheckpointScore:
    """How good a map is at checkpoints.

    Parameters
    ----------
    elevation : ErrorStatistics
        Of map minus checkpoint.
    interval : RmseInterval
        95 % interval of the RMSE.
    assessments : tuple of Assessment
        One or more for every standard that was asked for.
    left_out : tuple of str
        Checkpoints in the area where the map gives no height.
    n_outside : int
        Checkpoints outside the area.
    """

    elevation: ErrorStatistics
    interval: RmseInterval
    assessments: tuple[Assessment, ...]
    left_out: tuple[str, ...] = ()
    n_outside: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, with each finding's sentence.

        Returns
        -------
        dict
            Nested dictionaries and lists of plain values, ``None`` for NaN.
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

    Returns
    -------
    CheckpointScore
        Error statistics, interval of the RMSE, and the assessments.

    Raises
    ------
    ConfigError
        A standard that is not known.
    InputError
        A class or an interval that is not positive.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> here = Spread((0.25, 0.25, 0.25, 0.25), 0.1, 1e6)
    >>> def found(n):
    ...     names = tuple(str(k) for k in range(n))
    ...     return CheckpointErrors(rng.normal(0.0, 0.05, n), np.full(n, 0.02), np.zeros(n, bool), names, here)
    >>> [score_at(found(n), class_m=0.10).assessments[0].outcome for n in (29, 30)]
    ['not assessed to the standard', 'met']
    """
    for value, what in ((class_m, "class"), (interval_m, "contour interval")):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"the {what} is {value} m; a number above 0 was expected.")
    findings = [
        finding
        for name in standards
        for finding in _assessed(standard_named(name), errors, class_m, interval_m)
    ]
    return CheckpointScore(
        ErrorStatistics.of(errors.errors_m),
        RmseInterval.of(errors.errors_m),
        tuple(findings),
        errors.left_out,
        errors.n_outside,
    )


def _assessed(
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
    rmse, limit = _rmse(errors), k * interval_m / _DIVISORS[standard.name]
    missing = missing_in_general(standard, errors)
    if errors.checkpoint_rmse_m > interval_m / _CHECK_SURVEY_1990:
        missing.append(
            f"checkpoints accurate to {interval_m / _CHECK_SURVEY_1990:.3g} m (a twentieth of the interval), not {errors.checkpoint_rmse_m:.3g} m"
        )
    cautions = cautions_of(standard, errors, limit)
    if k > 1:
        cautions.append(f"the limit of class {k}, {k} times that of class 1, is unverified")
    label = f"Class {k}, interval {interval_m:.4g} m"
    return _finding(standard, errors, (label, "RMSE", rmse, limit), missing, cautions)


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
    return _finding(standard, errors, (label, measure, share, _SHARE_BEYOND), missing, cautions)


def _nssda(standard: Standard, errors: CheckpointErrors) -> Assessment:
    value = accuracy_z(_rmse(errors))
    cautions = [*datum_cautions(errors), "the standard sets no limit: the accuracy is stated, not passed"]
    return _finding(
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
    value = rmse_v(_rmse(open_), open_.checkpoint_rmse_m) if edition_2 else accuracy_z(_rmse(open_))
    limit = None if class_m is None else class_m if edition_2 else nva_limit_m(class_m)
    measure = "non-vegetated RMSE_V" if edition_2 else "non-vegetated accuracy at 95 %"
    missing = [*missing_number(standard, open_, n_open, "open"), *missing_accuracy(standard, open_, class_m)]
    cautions = cautions_of(standard, open_, class_m)
    yield _finding(standard, open_, (label, measure, value, limit), missing, cautions)
    if vegetated is None:
        return
    missing = [
        *missing_number(standard, vegetated, n_vegetated, "vegetated"),
        *missing_accuracy(standard, vegetated, class_m),
    ]
    if edition_2:
        value, limit, measure = (
            rmse_v(_rmse(vegetated), vegetated.checkpoint_rmse_m),
            None,
            "vegetated RMSE_V",
        )
    else:
        value = float(np.percentile(np.abs(vegetated.errors_m), 95.0))
        limit = None if class_m is None else vva_limit_m(class_m)
        measure = "vegetated 95th percentile"
    yield _finding(standard, vegetated, (label, measure, value, limit), missing, datum_cautions(vegetated))


def _finding(
    standard: Standard,
    errors: CheckpointErrors,
    asked: tuple[str, str, float, float | None],
    missing: list[str],
    cautions: list[str],
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
        tuple(cautions),
    )


def _rmse(errors: CheckpointErrors) -> float:
    return float(np.sqrt(np.mean(errors.errors_m**2)))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
