"""Assess checkpoints under a named accuracy standard; no verdict where its conditions are not met."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from survey.core.errors import InputError
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.standards.checkpoint_errors import CheckpointErrors
from survey.scoring.standards.findings import Assessment, assessed
from survey.scoring.standards.horizontal import horizontal_findings
from survey.scoring.standards.intervals import RmseInterval
from survey.scoring.standards.standards import (
    EDITION_2,
    standard_named,
)


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
        findings += assessed(standard, errors, class_m, interval_m)
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
