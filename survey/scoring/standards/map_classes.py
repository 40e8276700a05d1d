"""Classes of maps by accuracy standard, and verdicts on an RMSE."""

from dataclasses import dataclass

from survey.core.errors import ConfigError, InputError
from survey.scoring.standards.standards import CONTOURS, FOOT_M, LEAST_COVERED, PAPER, SPOT_HEIGHTS

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
    SPOT_HEIGHTS: _WHOLE_SURFACE + " Limit: class × interval / 6.",
    CONTOURS: "The RMSE is that of the whole surface against a reference surface; the limit is made for well-defined points read from contours."
    " Limit: class × interval / 3.",
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
