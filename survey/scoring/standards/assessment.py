"""Assess checkpoints under a named accuracy standard; no verdict where its conditions are not met."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from survey.core.errors import InputError
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.standards.checkpoints import CheckpointErrors, Spread
from survey.scoring.standards.formulas import (
    accuracy_z,
    checkpoints_2014,
    checkpoints_edition_2,
    nva_limit_m,
    rmse_v,
    vva_limit_m,
)
from survey.scoring.standards.intervals import RmseInterval
from survey.scoring.standards.standards import (
    ASPRS_2014,
    CONTOURS,
    EDITION_2,
    FOOT_M,
    LEAST_COVERED,
    SPOT_HEIGHTS,
    Standard,
    standard_named,
)

Outcome = Literal["met", "not met", "reported", "not assessed to the standard"]
NOT_ASSESSED: Outcome = "not assessed to the standard"
BLUNDER_FACTOR = 3.0
"""Errors beyond this many times the limit of the RMSE are to be investigated."""
_SHARE_BEYOND = 0.10
_DIVISORS = {SPOT_HEIGHTS: 6.0, CONTOURS: 3.0}
_INTERVALS_M = (FOOT_M, 2 * FOOT_M, 3 * FOOT_M)
# The check survey of 1990 may err by a twentieth of the contour interval.
_CHECK_SURVEY_1990 = 20.0
# Shares and spacings are compared with a hair of slack, so that 20 % of 30 points may be 6 of 30.
_SLACK = 1e-9


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
    missing = _general(standard, errors)
    if errors.checkpoint_rmse_m > interval_m / _CHECK_SURVEY_1990:
        missing.append(
            f"checkpoints accurate to {interval_m / _CHECK_SURVEY_1990:.3g} m (a twentieth of the interval), not {errors.checkpoint_rmse_m:.3g} m"
        )
    cautions = _cautions(standard, errors, limit)
    if k > 1:
        cautions.append(f"the limit of class {k}, {k} times that of class 1, is unverified")
    label = f"Class {k}, interval {interval_m:.4g} m"
    return _finding(standard, errors, (label, "RMSE", rmse, limit), missing, cautions)


def _nmas(standard: Standard, errors: CheckpointErrors, interval_m: float) -> Assessment:
    """Count the points beyond half an interval; no horizontal shift is granted."""
    share = float(np.mean(np.abs(errors.errors_m) > 0.5 * interval_m))
    cautions = [
        *_datum(errors),
        "the allowance for a horizontal shift within the map's tolerance is not used",
    ]
    label = f"contour interval {interval_m:.4g} m"
    measure = "share of points off by more than half the interval:"
    missing = _general(standard, errors)
    return _finding(standard, errors, (label, measure, share, _SHARE_BEYOND), missing, cautions)


def _nssda(standard: Standard, errors: CheckpointErrors) -> Assessment:
    value = accuracy_z(_rmse(errors))
    cautions = [*_datum(errors), "the standard sets no limit: the accuracy is stated, not passed"]
    return _finding(
        standard, errors, ("", "tested accuracy at 95 %", value, None), _general(standard, errors), cautions
    )


def _asprs_classes(
    standard: Standard, errors: CheckpointErrors, class_m: float | None
) -> Iterator[Assessment]:
    """Judge open ground by the class, vegetated ground as the edition has it."""
    n_open, n_vegetated = _counts(standard, errors.spread.area_m2 / 1e6)
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
    missing = [*_number(standard, open_, n_open, "open"), *_accuracy(standard, open_, class_m)]
    cautions = _cautions(standard, open_, class_m)
    yield _finding(standard, open_, (label, measure, value, limit), missing, cautions)
    if vegetated is None:
        return
    missing = [
        *_number(standard, vegetated, n_vegetated, "vegetated"),
        *_accuracy(standard, vegetated, class_m),
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
    yield _finding(standard, vegetated, (label, measure, value, limit), missing, _datum(vegetated))


def _finding(
    standard: Standard,
    errors: CheckpointErrors,
    asked: tuple[str, str, float, float | None],
    missing: list[str],
    cautions: list[str],
) -> Assessment:
    """Compare the value with the limit of what was asked (class, measure, value, limit), unless conditions are missing."""
    label, measure, value, limit = asked
    missing = [*missing, *_coverage(errors)]
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


def _coverage(errors: CheckpointErrors) -> list[str]:
    """Return what the map misses of the area."""
    if errors.covered_share >= LEAST_COVERED:
        return []
    return [f"heights on {LEAST_COVERED:.1%} of the area (the map covers {errors.covered_share:.1%})"]


def _counts(standard: Standard, area_km2: float) -> tuple[int, int]:
    if standard.name == ASPRS_2014:
        return checkpoints_2014(area_km2)
    n = checkpoints_edition_2(area_km2)
    return n, n


def _number(standard: Standard, errors: CheckpointErrors, n_least: int, ground: str) -> list[str]:
    n = len(errors.errors_m)
    if n >= n_least:
        return []
    return [f"{n_least} checkpoints on {ground} ground (there are {n}){_mark(standard, 'n_least')}"]


def _accuracy(standard: Standard, errors: CheckpointErrors, class_m: float | None) -> list[str]:
    """Compare the checkpoints' accuracy with what the class asks of them."""
    if class_m is None or standard.sharper is None:
        return []
    needed = class_m / standard.sharper
    if errors.checkpoint_rmse_m <= needed * (1.0 + _SLACK):
        return []
    return [
        f"checkpoints accurate to {needed:.3g} m ({standard.sharper:g} times better than the class), not {errors.checkpoint_rmse_m:.3g} m"
    ]


def _general(standard: Standard, errors: CheckpointErrors) -> list[str]:
    """Return what the standard misses in number and spread of the checkpoints."""
    missing = [] if standard.n_least is None else _number(standard, errors, standard.n_least, "any")
    share, spacing = standard.quadrant_share, standard.spacing_share
    found = min(errors.spread.quadrant_shares)
    if share is not None and found < share - _SLACK:
        missing.append(
            f"{share:.0%} of the checkpoints in every quarter of the area (one has {found:.0%}){_mark(standard, 'quadrant_share')}"
        )
    apart = errors.spread.spacing_share
    if spacing is not None and apart < spacing - _SLACK:
        missing.append(
            f"{spacing:.0%} of the diagonal between any two checkpoints (two are {apart:.1%} apart){_mark(standard, 'spacing_share')}"
        )
    return missing


def _cautions(standard: Standard, errors: CheckpointErrors, limit_m: float | None) -> list[str]:
    """Return what is to be investigated: a bias, blunders, a datum that is not stated."""
    found = _datum(errors)
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


def _datum(errors: CheckpointErrors) -> list[str]:
    if errors.has_datums:
        return []
    return ["the map or the checkpoints do not state their vertical datum; tens of metres can hide there"]


def _mark(standard: Standard, what: str) -> str:
    return " (unverified)" if what in standard.unverified else ""


def _rmse(errors: CheckpointErrors) -> float:
    return float(np.sqrt(np.mean(errors.errors_m**2)))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
