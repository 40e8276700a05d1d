"""Classes of maps by accuracy standard: verdicts on an RMSE, and certificates by a map's own claim.

`map_classes` lists the rows of the standards of 1990 with their contour intervals and limits; `judge` compares
an RMSE with them. `certificate` judges the posterior of a map's own root mean square error: absolute, and after
removing the best vertical offset. A class is certified where it is met with a probability of 95 %. A
certificate is as good as the map's standard deviation.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from survey.core.errors import ConfigError, InputError
from survey.core.lengths import FOOT_M
from survey.reconstruction.beyond_points import beyond_sentences
from survey.reconstruction.checks import CONFIDENCE, RmseClaim, RmsePosterior
from survey.reconstruction.level import TIES
from survey.reconstruction.terrain_map import ELEVATION, Reconstruction
from survey.scoring.standards.standards import (
    CONTOURS,
    DIVISORS,
    INTERVALS_FT,
    LEAST_COVERED,
    PAPER,
    SPOT_HEIGHTS,
)

if TYPE_CHECKING:
    from survey.reconstruction.motion.epoch import MapAge

# Tables I, II and III of the glacier paper: contour interval [m] and RMSE limit [m] by class.
_PAPER_TABLES: dict[int, tuple[tuple[float, float], ...]] = {
    1: ((0.3048, 0.0508), (0.6096, 0.1016), (0.9144, 0.1524)),
    2: ((0.6096, 0.1016), (1.2192, 0.2032), (1.8288, 0.3048)),
    3: ((0.9144, 0.1524), (1.8288, 0.3048), (2.7432, 0.4572)),
}
# ASPRS Accuracy Standards for Large-Scale Maps (1990): the limiting RMSE of class 1 over the interval.

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

    `standard`: name of the standard and of how it is read. `map_class`: ``"Class 1"`` (best) to ``"Class
    3"``. `interval_m`: contour interval [m]. `limit_m`: largest RMSE of the elevation [m].
    """

    standard: str
    map_class: str
    interval_m: float
    limit_m: float


@dataclass(frozen=True)
class Verdict:
    """Whether a map meets one row of a standard.

    `standard`, `map_class`: as in `MapClass`. `interval_m`: contour interval [m]. `limit_m`: largest RMSE
    allowed [m]. `rmse_m`: the map's [m]. `met`: the RMSE is not above the limit, and the verdict is not
    withheld. `note`: assumptions of the comparison, and the reason where the verdict is withheld.
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
    elif standard in DIVISORS:
        rows = [
            (k, feet * FOOT_M, k * feet * FOOT_M / DIVISORS[standard])
            for k in (1, 2, 3)
            for feet in INTERVALS_FT
        ]
    else:
        known = ", ".join(_NOTES)
        raise ConfigError(f"the accuracy standard {standard!r} is not known; one of {known} was expected.")
    rows.sort(key=lambda row: (-row[2], -row[0], -row[1]))
    return tuple(MapClass(standard, f"Class {k}", interval, limit) for k, interval, limit in rows)


def judge(rmse_m: float, standard: str = PAPER, *, covered_share: float = 1.0) -> tuple[Verdict, ...]:
    """Judge an RMSE by every row of a standard, the loosest first.

    `rmse_m`: RMSE of the map [m].

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


def edition_2_class(rmse_m: float) -> str:
    """Return the tightest vertical class of ASPRS Edition 2 that an RMSE meets, in steps of a millimetre.

    The edition lists no classes: a class of # cm means that the RMSE is at most # cm (section 7.4).

    >>> edition_2_class(0.0604), edition_2_class(0.1)
    ('6.1 cm class', '10.0 cm class')
    """
    return f"{math.ceil(round(1000.0 * rmse_m, 6)) / 10.0:.1f} cm class"


def edition_2_sentence(rmse_m: float, covered_share: float) -> str:
    """Return the class of ASPRS Edition 2 that an RMSE on a reference surface meets, or why none is stated.

    >>> edition_2_sentence(0.0604, 1.0)
    '6.1 cm class, vertical, by ASPRS Edition 2 (2024): RMSE 0.060 m on the reference'
    """
    if covered_share < LEAST_COVERED:
        return f"{uncovered_sentence(covered_share)} RMSE on the covered part {rmse_m:.3f} m"
    return f"{edition_2_class(rmse_m)}, vertical, by ASPRS Edition 2 (2024): RMSE {rmse_m:.3f} m on the reference"


def uncovered_sentence(covered_share: float) -> str:
    """Return the sentence that says why no class is stated for a map with gaps.

    >>> uncovered_sentence(0.942)
    'No class is stated: the map covers 94.2 % of the area, and 99.9 % are needed.'
    """
    percent = f"{100.0 * covered_share:.1f}" if covered_share < 0.9985 else f"{100.0 * covered_share:.2f}"
    return f"No class is stated: the map covers {percent} % of the area, and {100.0 * LEAST_COVERED:g} % are needed."


LARGEST_UNTESTED = 0.05
"""Largest share of the ground beyond the distances of points left out for which a class is stated."""


@dataclass(frozen=True)
class Certificate:
    """Classes that a map meets by its own claim with a probability of at least 95 %.

    Parameters
    ----------
    claim : RmseClaim
        Posterior of the map's root mean square error.
    absolute : tuple of Verdict
        One for each row of the standard, the loosest first; their RMSE is what the error stays below with 95 %.
    relative : tuple of Verdict
        The same after removing the best vertical offset.
    is_tested : bool
        Whether points that were left out have tested the standard deviation.

    Notes
    -----
    It is as good as the map's standard deviation. Errors that no point and no prior shows, such as a wrong
    vertical datum of everything, are not in it.
    """

    claim: RmseClaim
    absolute: tuple[Verdict, ...]
    relative: tuple[Verdict, ...]
    is_tested: bool

    @property
    def sentences(self) -> tuple[str, ...]:
        """Absolute and relative error with their class, and what known heights change of the level, in one sentence each."""
        untested = "" if self.is_tested else "; the standard deviation was not tested by points left out"
        tied = ", ".join(f"{self.claim.tied_m[name]:.3f} m with {tie.name}" for name, tie in TIES.items())
        return (
            f"absolute error by the map's own claim: {_error(self.claim.absolute, self.absolute)}{untested}.",
            f"relative error, after removing the best vertical offset: {_error(self.claim.relative, self.relative)}.",
            f"its level errs by {self.claim.offset_sigma_m:.3f} m (1 σ), {self.claim.level_share:.0%} of the squared error; "
            f"the RMSE would be {tied}.",
        )


def certificate(reconstruction: Reconstruction, standard: str = PAPER) -> Certificate | None:
    """State the classes of a map by its own claim.

    A class is met where the root mean square error is within its limit with a probability of at least 95 %, by
    the posterior that follows from the joint covariance of the map's errors. The sentences state the class of ASPRS
    Edition 2, as `score` does; the verdicts are of the rows of `standard`. Both are withheld where more than 5 %
    of the ground lies farther from the points than those that were left out, as around a single swath.

    Parameters
    ----------
    reconstruction : Reconstruction
        A map of elevation.
    standard : str
        As in `map_classes`.

    Returns
    -------
    Certificate or None
        None for a map without a joint covariance: triangles, lattices, maps in tiles.

    Raises
    ------
    ConfigError
        An unknown standard.

    Examples
    --------
    >>> import numpy as np
    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 40.0), 10.0)
    >>> flat = Dem.on(grid, np.zeros(grid.shape))
    >>> certificate(Reconstruction(flat, flat, np.full(grid.shape, 3), "tin", {})) is None
    True
    """
    claim = reconstruction.claim
    if claim is None:
        return None
    absolute, relative = (
        _verdicts(one.upper_m, standard, claim.untested_share) for one in (claim.absolute, claim.relative)
    )
    return Certificate(claim, absolute, relative, reconstruction.check is not None)


def own_claim(reconstruction: Reconstruction) -> list[str]:
    """Return what a map states of itself, in sentences: the check by points left out, and its classes.

    Returns: empty for a map that was neither tested nor has a joint covariance; classes and age are of elevation only.
    """
    if reconstruction.quantity != ELEVATION:
        return beyond_sentences(reconstruction)
    check, certified = reconstruction.check, certificate(reconstruction)
    sentences = [] if check is None else [check.sentence]
    sentences += beyond_sentences(reconstruction)
    sentences += [] if certified is None else [*certified.sentences]
    age = stated_age(reconstruction)
    return sentences + ([] if age is None else [age])


def stated_age(reconstruction: Reconstruction) -> str | None:
    """Return the motion of the ice and for how long a map holds its class, as the map states them.

    Returns: None for a map of ground at rest.
    """
    from survey.reconstruction.motion.epoch import AGE, MapAge

    facts = reconstruction.diagnostics.get(AGE)
    return None if facts is None else age_sentence(MapAge.from_facts(dict(facts)))


def age_sentence(age: "MapAge") -> str:
    """Return the motion of the ice and for how long the map of its epoch keeps its class.

    >>> from survey.reconstruction.motion.epoch import MapAge
    >>> print(*age_sentence(MapAge(3600.0, 2.0, 0.1, 0.05, 0.02, 0.3, 0.4)).split())
    the ice moves by 2.00 ± 0.10 m a day and lowers by 0.050 ± 0.020 m a day; the map is that of 1.0 h, and left as it is, it meets Class 2 of ASPRS 1990 (limit 0.305 m) until 3.3 h after.
    """
    verdicts = judge(age.rmse_m)
    met = [verdict for verdict in verdicts if verdict.met]
    ending = "it meets no class of ASPRS 1990"
    if met:
        until_h = age.hours_within(met[-1].limit_m)
        ending = f"left as it is, it meets {met[-1].map_class} of ASPRS 1990 (limit {met[-1].limit_m:.3f} m) until {until_h:.1f} h after"
    return (
        f"the ice moves by {age.speed_m_per_day:.2f} ± {age.speed_sigma_m_per_day:.2f} m a day and lowers by "
        f"{age.lowering_m_per_day:.3f} ± {age.lowering_sigma_m_per_day:.3f} m a day; the map is that of "
        f"{age.epoch_s / 3600.0:.1f} h, and {ending}."
    )


def _verdicts(upper_m: float, standard: str, untested_share: float) -> tuple[Verdict, ...]:
    """Return the verdicts on an error, withheld where the ground lies too far from the points to have been tested."""
    verdicts = judge(upper_m, standard)
    if untested_share <= LARGEST_UNTESTED:
        return verdicts
    reason = f"No class is stated: {100.0 * untested_share:.0f} % of the ground lies farther from the points than any test."
    return tuple(replace(verdict, met=False, note=f"{reason} {verdict.note}") for verdict in verdicts)


def _error(posterior: RmsePosterior, verdicts: tuple[Verdict, ...]) -> str:
    """Return the expected error, its 95 % limit and the class of that limit, or why none is stated, as text."""
    if any(verdict.is_withheld for verdict in verdicts):
        reason = verdicts[0].note.partition(". ")[0]
        stated = reason[0].lower() + reason[1:]
    else:
        stated = f"{edition_2_class(posterior.upper_m)} by ASPRS Edition 2 (2024)"
    return (
        f"RMSE {posterior.expected_m:.3f} ± {posterior.sigma_m:.3f} m, below {posterior.upper_m:.3f} m with a "
        f"probability of {100.0 * CONFIDENCE:g} %, {stated}"
    )
