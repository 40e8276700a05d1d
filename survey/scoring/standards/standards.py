"""Map accuracy standards as data: editions, conditions and limits, and the glacier paper's reading of 1990.

What could not be checked against a copy of a standard's text is named in `Standard.unverified`, and is shown
to users as unverified wherever it decides something.
"""

from dataclasses import dataclass
from typing import Literal

from survey.core.errors import ConfigError, InputError

FOOT_M = 0.3048
PAPER = "asprs-1990-as-in-paper"
SPOT_HEIGHTS = "asprs-1990-spot-heights"
CONTOURS = "asprs-1990-contours"
NMAS = "nmas-1947"
NSSDA = "nssda-1998"
ASPRS_2014 = "asprs-2014"
EDITION_2 = "asprs-edition-2"

LEAST_COVERED = 0.999
"""Share of the area that a map must cover for a class to be stated."""

AccuracyMeasure = Literal["rmse", "share", "accuracy_95", "nva_vva", "rmse_v"]


@dataclass(frozen=True)
class Standard:
    """What a standard asks of checkpoints, and how it judges them.

    Parameters
    ----------
    name : str
        As users name it.
    edition : str
        Title and year.
    measure : {"rmse", "share", "accuracy_95", "nva_vva", "rmse_v"}
        What is compared with the limit: the RMSE; the share of points within half an
        interval; 95 % accuracy, which is only stated; 95 % accuracy and percentile on open
        and vegetated ground; the RMSE with the checkpoints' own error.
    n_least : int, optional
        Least number of checkpoints (of either kind, where there are two).
    quadrant_share : float, optional
        Least share of them in each quarter of the area.
    spacing_share : float, optional
        Least distance between two of them over the area's diagonal.
    sharper : float, optional
        How many times more accurate than the class they must be.
    bias_share : float, optional
        Mean error over RMSE limit beyond which it is to be investigated.
    unverified : frozenset of str
        Names of the above, and of limits, whose value was not found in a copy of the text.
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
_1990_MEMORY = frozenset({"n_least", "quadrant_share", "spacing_share", "classes 2 and 3", "blunders"})

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

    Raises
    ------
    ConfigError
        An unknown name.

    Examples
    --------
    >>> standard_named("asprs-edition-2").n_least
    30
    """
    if name not in STANDARDS:
        raise ConfigError(
            f"the accuracy standard {name!r} is not known; one of {', '.join(STANDARDS)} was expected."
        )
    return STANDARDS[name]


# Tables I, II and III of the glacier paper: contour interval [m] and RMSE limit [m] by class.
_PAPER_TABLES: dict[int, tuple[tuple[float, float], ...]] = {
    1: ((0.3048, 0.0508), (0.6096, 0.1016), (0.9144, 0.1524)),
    2: ((0.6096, 0.1016), (1.2192, 0.2032), (1.8288, 0.3048)),
    3: ((0.9144, 0.1524), (1.8288, 0.3048), (2.7432, 0.4572)),
}
# ASPRS Accuracy Standards for Large-Scale Maps (1990): the limiting RMSE of class 1 over the interval.
_DIVISORS = {SPOT_HEIGHTS: 6.0, CONTOURS: 3.0}
_INTERVALS_FT = (1, 2, 3)

_WHOLE_SURFACE = (
    "The RMSE is that of the whole surface against a reference surface; the limit is made for spot heights at "
    "20 or more well-defined check points."
)
_NOTES = {
    PAPER: _WHOLE_SURFACE
    + " The intervals are those printed in the paper; under the 1990 standard the same limits belong to intervals of 1, 2 and 3 ft in every class.",
    SPOT_HEIGHTS: _WHOLE_SURFACE
    + " Limit: class × interval / 6; the factors of classes 2 and 3 were not checked against the standard's own text.",
    CONTOURS: "The RMSE is that of the whole surface against a reference surface; the limit is made for well-defined points read from contours."
    " Limit: class × interval / 3; the factors of classes 2 and 3 were not checked against the standard's own text.",
}


@dataclass(frozen=True)
class MapClass:
    """One row of a standard.

    Parameters
    ----------
    standard : str
        Name of the standard and of how it is read.
    map_class : str
        ``"Class 1"`` (best) to ``"Class 3"``.
    interval_m : float
        Contour interval [m].
    limit_m : float
        Largest RMSE of the elevation [m].
    """

    standard: str
    map_class: str
    interval_m: float
    limit_m: float


@dataclass(frozen=True)
class Verdict:
    """Whether a map meets one row of a standard.

    Parameters
    ----------
    standard, map_class : str
        As in `MapClass`.
    interval_m : float
        Contour interval [m].
    limit_m : float
        Largest RMSE allowed [m].
    rmse_m : float
        The map's [m].
    met : bool
        The RMSE is not above the limit, and the verdict is not withheld.
    note : str
        Assumptions of the comparison, and the reason where the verdict is withheld.
    """

    standard: str
    map_class: str
    interval_m: float
    limit_m: float
    rmse_m: float
    met: bool
    note: str

    @property
    def is_withheld(self) -> bool:
        """The RMSE is within the limit, but the map does not cover the area."""
        return self.rmse_m <= self.limit_m and not self.met


def map_classes(standard: str = PAPER) -> tuple[MapClass, ...]:
    """Return the rows of a standard, the loosest limit first.

    Parameters
    ----------
    standard : str
        ``asprs-1990-as-in-paper`` (Tables I to III of the glacier paper),
        ``asprs-1990-spot-heights`` or ``asprs-1990-contours`` (intervals of 1, 2 and 3 ft).

    Returns
    -------
    tuple of MapClass
        The loosest limit first.

    Raises
    ------
    ConfigError
        An unknown standard.

    Notes
    -----
    The paper's limits are all a sixth of its printed interval. They equal the spot-height
    limits of 1990 when its intervals are divided by the class: doubling and tripling
    belongs to the limit, not to the interval.

    Examples
    --------
    >>> map_classes()[0]
    MapClass(standard='asprs-1990-as-in-paper', map_class='Class 3', interval_m=2.7432, limit_m=0.4572)
    """
    if standard == PAPER:
        rows = [(k, interval, limit) for k, table in _PAPER_TABLES.items() for interval, limit in table]
    elif standard in _DIVISORS:
        rows = [
            (k, feet * FOOT_M, k * feet * FOOT_M / _DIVISORS[standard])
            for k in (1, 2, 3)
            for feet in _INTERVALS_FT
        ]
    else:
        known = ", ".join(_NOTES)
        raise ConfigError(f"the accuracy standard {standard!r} is not known; one of {known} was expected.")
    rows.sort(key=lambda row: (-row[2], -row[0], -row[1]))
    return tuple(MapClass(standard, f"Class {k}", interval, limit) for k, interval, limit in rows)


def judge(rmse_m: float, standard: str = PAPER, *, covered_share: float = 1.0) -> tuple[Verdict, ...]:
    """Judge an RMSE by every row of a standard, the loosest first.

    Parameters
    ----------
    rmse_m : float
        RMSE of the map [m].
    standard : str
        As in `map_classes`.
    covered_share : float
        Share of the area that the map covers. Below `LEAST_COVERED` no class is met: the verdict is withheld
        where the RMSE is within the limit.

    Returns
    -------
    tuple of Verdict
        One for each row.

    Raises
    ------
    InputError
        An RMSE that is negative or NaN.
    ConfigError
        An unknown standard.

    Examples
    --------
    >>> [verdict.met for verdict in judge(0.31)][:3]
    [True, False, False]
    >>> [verdict.is_withheld for verdict in judge(0.31, covered_share=0.9)][:3]
    [True, False, False]
    """
    if not rmse_m >= 0.0:
        raise InputError(f"the RMSE to judge is {rmse_m} m; a number of 0 or more was expected.")
    is_covered = covered_share >= LEAST_COVERED
    gap = "" if is_covered else f"{uncovered_sentence(covered_share)} "
    return tuple(
        Verdict(
            row.standard,
            row.map_class,
            row.interval_m,
            row.limit_m,
            rmse_m,
            is_covered and rmse_m <= row.limit_m,
            gap + _NOTES[standard],
        )
        for row in map_classes(standard)
    )


def uncovered_sentence(covered_share: float) -> str:
    """Return the sentence that says why no class is stated for a map with gaps.

    Examples
    --------
    >>> uncovered_sentence(0.942)
    'No class is stated: the map covers 94.2 % of the area, and 99.9 % are needed.'
    """
    percent = f"{100.0 * covered_share:.1f}" if covered_share < 0.9985 else f"{100.0 * covered_share:.2f}"
    return f"No class is stated: the map covers {percent} % of the area, and {100.0 * LEAST_COVERED:g} % are needed."
