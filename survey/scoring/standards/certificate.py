"""Classes of a map by its own claim: absolute, and after removing the best vertical offset."""

from dataclasses import dataclass, replace

from survey.reconstruction.base import Reconstruction
from survey.reconstruction.beyond_points import beyond_sentences
from survey.reconstruction.checks.rmse_claim import CONFIDENCE, RmseClaim, RmsePosterior
from survey.reconstruction.motion.map_age import AGE, MapAge
from survey.scoring.standards.map_classes import Verdict, judge
from survey.scoring.standards.standards import PAPER

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
    def sentences(self) -> tuple[str, str]:
        """Absolute and relative error with their class, in one sentence each."""
        untested = "" if self.is_tested else "; the standard deviation was not tested by points left out"
        offset = f"its level errs by {self.claim.offset_sigma_m:.3f} m (1 σ)"
        return (
            f"absolute error by the map's own claim: {_error(self.claim.absolute, self.absolute)}; {offset}{untested}.",
            f"relative error, after removing the best vertical offset: {_error(self.claim.relative, self.relative)}.",
        )


def certificate(reconstruction: Reconstruction, standard: str = PAPER) -> Certificate | None:
    """State the classes of a map by its own claim.

    A class is met where the root mean square error is within its limit with a probability of at least 95 %, by
    the posterior that follows from the joint covariance of the map's errors. The verdict is withheld where more than 5 %
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
    """Return what a map of elevation states of itself, in sentences: the check by points left out, and its classes.

    Parameters
    ----------
    reconstruction : Reconstruction
        A map of elevation.

    Returns
    -------
    list of str
        Empty for a map that was neither tested nor has a joint covariance.
    """
    check, certified = reconstruction.check, certificate(reconstruction)
    sentences = [] if check is None else [check.sentence]
    sentences += beyond_sentences(reconstruction)
    sentences += [] if certified is None else [*certified.sentences]
    age = stated_age(reconstruction)
    return sentences + ([] if age is None else [age])


def stated_age(reconstruction: Reconstruction) -> str | None:
    """Return the motion of the ice and for how long a map holds its class, as the map states them.

    Parameters
    ----------
    reconstruction : Reconstruction
        A map.

    Returns
    -------
    str or None
        None for a map of ground at rest.
    """
    facts = reconstruction.diagnostics.get(AGE)
    return None if facts is None else age_sentence(MapAge.from_facts(dict(facts)))


def age_sentence(age: MapAge) -> str:
    """Return the motion of the ice and for how long the map of its epoch keeps its class.

    Parameters
    ----------
    age : MapAge
        Age of a map of moving ice.

    Returns
    -------
    str
        One sentence.

    Examples
    --------
    >>> print(*age_sentence(MapAge(3600.0, 2.0, 0.1, 0.05, 0.02, 0.3, 0.4)).split())
    the ice moves by 2.00 ± 0.10 m a day and lowers by 0.050 ± 0.020 m a day; the map is that of 1.0 h, and left as it is, it meets Class 2 (limit 0.305 m) until 3.3 h after.
    """
    verdicts = judge(age.rmse_m)
    met = [verdict for verdict in verdicts if verdict.met]
    ending = "it meets no class"
    if met:
        until_h = age.hours_within(met[-1].limit_m)
        ending = f"left as it is, it meets {met[-1].map_class} (limit {met[-1].limit_m:.3f} m) until {until_h:.1f} h after"
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
    """Return the expected error, its 95 % limit and the tightest class met, as text."""
    met = [verdict for verdict in verdicts if verdict.met]
    if any(verdict.is_withheld for verdict in verdicts):
        reason = verdicts[0].note.partition(". ")[0]
        stated = reason[0].lower() + reason[1:]
    else:
        stated = _tightest(verdicts, met)
    return (
        f"RMSE {posterior.expected_m:.3f} ± {posterior.sigma_m:.3f} m, below {posterior.upper_m:.3f} m with a "
        f"probability of {100.0 * CONFIDENCE:g} %, {stated}"
    )


def _tightest(verdicts: tuple[Verdict, ...], met: list[Verdict]) -> str:
    """Return the tightest class met, or that none is, as text."""
    return (
        f"{met[-1].map_class} met (limit {met[-1].limit_m:.3f} m)"
        if met
        else f"no class met (loosest limit {verdicts[0].limit_m:.3f} m)"
    )
