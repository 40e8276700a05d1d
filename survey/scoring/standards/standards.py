"""Map accuracy standards: editions, conditions and limits as data, and their formulas.

Each `Standard` states what an edition asks of checkpoints, and how it judges them; one is the glacier paper's
reading of the standard of 1990. The formulas lead from an RMSE to the values that each edition states, and back
to limits. NSSDA is the National Standard for Spatial Data Accuracy (FGDC-STD-007.3-1998), NMAS the National Map
Accuracy Standards of 1947. What could not be checked against a copy of a standard's text is named in
`Standard.unverified`, or in the docstring of a formula; users see it as unverified wherever it decides
something.
"""

import math
from dataclasses import dataclass
from typing import Literal

from survey.core.errors import ConfigError, InputError

INCH_M = 0.0254
PAPER = "asprs-1990-as-in-paper"
SPOT_HEIGHTS = "asprs-1990-spot-heights"
CONTOURS = "asprs-1990-contours"
NMAS = "nmas-1947"
NSSDA = "nssda-1998"
ASPRS_2014 = "asprs-2014"
EDITION_2 = "asprs-edition-2"
DIVISORS = {SPOT_HEIGHTS: 6.0, CONTOURS: 3.0}
"""Contour interval over the largest RMSE of class 1, in the standard of 1990."""
INTERVALS_FT = (1, 2, 3)
"""Contour intervals for which the classes of 1990 are stated."""

LEAST_COVERED = 0.999
"""Share of the area that a map must cover for a class to be stated."""

AccuracyMeasure = Literal["rmse", "share", "accuracy_95", "nva_vva", "rmse_v"]


@dataclass(frozen=True)
class Standard:
    """What a standard asks of checkpoints, and how it judges them.

    `name`: as users name it. `edition`: title and year. `measure`: what is compared with the limit: the RMSE;
    the share of points within half an interval; 95 % accuracy, which is only stated; 95 % accuracy and
    percentile on open and vegetated ground; the RMSE with the checkpoints' own error. `n_least`: least number
    of checkpoints (of either kind, where there are two). `quadrant_share`: share of them in each quarter of
    the area that is advised at least; no condition. `spacing_share`: distance between two of them over the
    area's diagonal that is advised at least; no condition. `sharper`: how many times more accurate than the
    class they must be. `bias_share`: mean error over RMSE limit beyond which it is to be investigated.
    `unverified`: names of the above, and of limits, whose value was not found in a copy of the text.
    """

    name: str
    edition: str
    measure: AccuracyMeasure
    n_least: int | None = None
    quadrant_share: float | None = None
    spacing_share: float | None = None
    sharper: float | None = None
    bias_share: float | None = None
    unverified: frozenset[str] = frozenset()


_1990 = "ASPRS Accuracy Standards for Large-Scale Maps (March 1990)"
_1990_MEMORY = frozenset({"n_least", "quadrant_share", "spacing_share", "blunders"})

STANDARDS = {
    standard.name: standard
    for standard in (
        Standard(SPOT_HEIGHTS, f"{_1990}, spot heights", "rmse", 20, 0.15, 0.10, unverified=_1990_MEMORY),
        Standard(CONTOURS, f"{_1990}, contours", "rmse", 20, 0.15, 0.10, unverified=_1990_MEMORY),
        Standard(NMAS, "United States National Map Accuracy Standards (June 1947)", "share"),
        Standard(
            NSSDA,
            "National Standard for Spatial Data Accuracy, FGDC-STD-007.3-1998",
            "accuracy_95",
            n_least=20,
            quadrant_share=0.20,
            spacing_share=0.10,
        ),
        Standard(
            ASPRS_2014,
            "ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 1 (November 2014)",
            "nva_vva",
            n_least=20,
            sharper=3.0,
            bias_share=0.25,
            unverified=frozenset({"bias_share", "blunders"}),
        ),
        Standard(
            EDITION_2,
            "ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2 (2024)",
            "rmse_v",
            n_least=30,
            sharper=2.0,
            bias_share=0.25,
        ),
    )
}
"""The standards that judge checkpoints, by name."""


def standard_named(name: str) -> Standard:
    """Return a standard that judges checkpoints.

    >>> standard_named("asprs-edition-2").n_least
    30
    """
    if name not in STANDARDS:
        raise ConfigError(
            f"the accuracy standard {name!r} is not known; one of {', '.join(STANDARDS)} was expected."
        )
    return STANDARDS[name]


# Two-sided 95 % and 90 % of a normal error, and the circular 95 % and 90 % in standard deviations of one axis.
Z95, Z90, C95, C90 = 1.9600, 1.6449, 2.4477, 2.1460
VVA_FACTOR = 3.00
"""The limit of vegetated ground in 2014: a 95th percentile of three times the class."""
SMALLEST_RATIO = 0.6
"""Below this ratio of the two axes' RMSEs the NSSDA gives no radial accuracy."""
# NMAS: tolerance on paper for scales larger than 1:20,000 and for the others.
_LARGEST_SMALL_SCALE = 20_000.0


def accuracy_z(rmse_z_m: float) -> float:
    """Return the vertical accuracy at 95 % [m] (NSSDA, appendix 3-A): ``1.9600 · RMSE_z``, for normal errors without bias.

    >>> round(accuracy_z(0.0815), 3)
    0.16
    """
    return Z95 * _size(rmse_z_m, "RMSE_z")


def accuracy_r(rmse_x_m: float, rmse_y_m: float) -> float | None:
    r"""Return the horizontal accuracy at 95 % [m] (NSSDA, appendix 3-A).

    .. math::  2.4477 \cdot \tfrac{1}{2}(RMSE_x + RMSE_y)

    which for equal axes is ``1.7308 · RMSE_r``.

    Returns: ``None`` where the smaller RMSE is less than 0.6 of the larger one: state both instead.

    >>> round(accuracy_r(0.6, 1.0), 4), accuracy_r(0.5, 1.0)
    (1.9582, None)
    """
    low, high = sorted((_size(rmse_x_m, "RMSE_x"), _size(rmse_y_m, "RMSE_y")))
    if low < SMALLEST_RATIO * high:
        return None
    return C95 * 0.5 * (low + high)


def rmse_v(fit_m: float, checkpoints_m: float) -> float:
    r"""Return the vertical RMSE of ASPRS Edition 2 [m], with the error of the checkpoints' own survey.

    .. math::  RMSE_V = \sqrt{RMSE_{V1}^2 + RMSE_{V2}^2}

    >>> round(rmse_v(0.070, 0.020), 4)
    0.0728
    """
    return math.hypot(_size(fit_m, "RMSE_V1"), _size(checkpoints_m, "RMSE_V2"))


def rmse_h(rmse_x_m: float, rmse_y_m: float, checkpoints_m: float) -> float:
    """Return the horizontal RMSE of ASPRS Edition 2 [m]; the checkpoints' error is that of one axis.

    >>> round(rmse_h(0.04, 0.03, 0.01), 5)
    0.05196
    """
    x, y = _size(rmse_x_m, "RMSE_x"), _size(rmse_y_m, "RMSE_y")
    return math.hypot(x, y, math.sqrt(2.0) * _size(checkpoints_m, "the checkpoints' RMSE per axis"))


def rmse_3d(rmse_h_m: float, rmse_v_m: float) -> float:
    """Return the three-dimensional RMSE of ASPRS Edition 2 [m].

    >>> rmse_3d(0.3, 0.4)
    0.5
    """
    return math.hypot(_size(rmse_h_m, "RMSE_H"), _size(rmse_v_m, "RMSE_V"))


def vmas(rmse_z_m: float) -> float:
    """Return the vertical error at 90 % [m] as NMAS has it, ``1.6449 · RMSE_z``: a conversion, NMAS itself counts points.

    >>> round(vmas(1.0), 4)
    1.6449
    """
    return Z90 * _size(rmse_z_m, "RMSE_z")


def cmas(rmse_x_m: float, rmse_y_m: float) -> float:
    """Return the circular error at 90 % [m] as NMAS has it, for nearly equal axes: ``2.1460`` times their mean RMSE.

    >>> round(cmas(1.0, 1.0), 3)
    2.146
    """
    return C90 * 0.5 * (_size(rmse_x_m, "RMSE_x") + _size(rmse_y_m, "RMSE_y"))


def nmas_horizontal_limit_m(scale: float) -> float:
    """Return the ground distance [m] that at most 10 % of well-defined points of a map 1:scale may be off (NMAS).

    1/30 inch on maps larger than 1:20,000, 1/50 inch on the others.

    >>> round(nmas_horizontal_limit_m(24_000), 1), round(nmas_horizontal_limit_m(12_000), 1)
    (12.2, 10.2)
    """
    denominator = _size(scale, "the scale's denominator")
    return denominator * INCH_M / (30.0 if denominator < _LARGEST_SMALL_SCALE else 50.0)


def asprs_1990_horizontal_limit_m(scale: float) -> float:
    """Return the limit [m] of RMSE_x and of RMSE_y for class 1 of ASPRS 1990: a quarter of a millimetre on the map.

    >>> asprs_1990_horizontal_limit_m(500)
    0.125
    """
    return 0.00025 * _size(scale, "the scale's denominator")


def nva_limit_m(class_m: float) -> float:
    """Return the limit [m] of the non-vegetated accuracy at 95 % for a class of ASPRS 2014: ``1.96`` times the class.

    >>> round(nva_limit_m(0.10), 3)
    0.196
    """
    return Z95 * _size(class_m, "the class")


def vva_limit_m(class_m: float) -> float:
    """Return the limit [m] of the vegetated 95th percentile for a class of ASPRS 2014: ``3.00`` times the class.

    >>> round(vva_limit_m(0.10), 3)
    0.3
    """
    return VVA_FACTOR * _size(class_m, "the class")


def equivalent_intervals_m(rmse_z_m: float) -> dict[str, float]:
    """Return the contour intervals [m] that an RMSE just supports: ASPRS 1990 classes 1 and 2, and NMAS.

    The factor of class 2 (1.5) could not be checked against the standard's own text.

    >>> {name: round(value, 4) for name, value in equivalent_intervals_m(0.10).items()}
    {'asprs-1990 class 1': 0.3, 'asprs-1990 class 2': 0.15, 'nmas': 0.329}
    """
    rmse = _size(rmse_z_m, "RMSE_z")
    return {"asprs-1990 class 1": 3.0 * rmse, "asprs-1990 class 2": 1.5 * rmse, "nmas": 2.0 * Z90 * rmse}


def checkpoints_2014(area_km2: float) -> tuple[int, int]:
    """Return the least numbers of non-vegetated and vegetated checkpoints for an area (ASPRS 2014).

    Up to 500 km² 20 and 5; up to 2,500 km² five more of each for every 250 km² begun (rows in between could not
    be checked; both ends were); beyond, three and two more for every 500 km² begun.

    >>> checkpoints_2014(0.36), checkpoints_2014(2500.0), checkpoints_2014(12_950.0)
    ((20, 5), (55, 45), (118, 87))
    """
    area = _size(area_km2, "the area")
    if area <= 500.0:
        return 20, 5
    if area <= 2500.0:
        # Both kinds gain five a row, but the first row adds vegetated ones alone.
        rows = math.ceil((area - 500.0) / 250.0)
        return 20 + 5 * max(0, rows - 1), 5 + 5 * rows
    blocks = math.ceil((area - 2500.0) / 500.0)
    return 55 + 3 * blocks, 45 + 2 * blocks


def checkpoints_edition_2(area_km2: float) -> int:
    """Return the least number of checkpoints for an area (ASPRS Edition 2), of either kind: 30 to 120.

    The steps in between, ten for every 1,000 km² begun beyond the first, could not be checked; both ends were.

    >>> checkpoints_edition_2(0.36), checkpoints_edition_2(50_000.0)
    (30, 120)
    """
    blocks = max(0, math.ceil(_size(area_km2, "the area") / 1000.0) - 1)
    return min(120, 30 + 10 * blocks)


def _size(value: float, what: str) -> float:
    """Return a finite number of 0 or more, or refuse."""
    if not (math.isfinite(value) and value >= 0.0):
        raise InputError(f"{what} is {value}; a number of 0 or more was expected.")
    return float(value)
