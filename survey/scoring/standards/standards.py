"""Map accuracy standards as data: editions, conditions and limits, and the glacier paper's reading of 1990.

What could not be checked against a copy of a standard's text is named in `Standard.unverified`, and is shown
to users as unverified wherever it decides something.
"""

from dataclasses import dataclass
from typing import Literal

from survey.core.errors import ConfigError

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
        Share of them in each quarter of the area that is advised at least; no condition.
    spacing_share : float, optional
        Distance between two of them over the area's diagonal that is advised at least; no condition.
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
