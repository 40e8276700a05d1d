r"""Posterior of the root mean square error of a map, from the joint covariance of its errors.

The covariance follows from a kernel, and grounds differ from any kernel that was fitted to them. So the errors count as
:math:`e^s` times as large as the covariance states, with s normal.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.special import ndtri

from survey.core.arrays import FloatArray, IntArray
from survey.core.weighted_chi_square import WeightedChiSquare

CONFIDENCE = 0.95
"""Probability with which a class of a map is stated from its own claim."""
_MOST_NODES = 400
# With it at most 5 % of the errors, absolute and relative, of 192 maps of twelve kinds of ground exceed their limit.
_SCALE_LOG_SD = 0.22
# Equally probable values of a standard normal variable.
_STANDARD = ndtri((np.arange(200) + 0.5) / 200)


@dataclass(frozen=True)
class RmsePosterior:
    """Posterior of a root mean square error.

    Parameters
    ----------
    expected_m : float
        Root of the expected mean square error [m].
    sigma_m : float
        Standard deviation of the root mean square error, to first order [m].
    upper_m : float
        What it stays below with a probability of 95 % [m].
    """

    expected_m: float
    sigma_m: float
    upper_m: float

    @classmethod
    def of(cls, covariance_m2: FloatArray) -> Self:
        r"""Compute the posterior for normal errors of mean 0, whose size is uncertain.

        .. math:: \mathrm{RMSE}^2 = e^{2 s} Q, \quad s \sim N(-\tau^2, \tau^2), \quad \tau = 0.22,

        with Q the mean square of errors with this covariance; the expectation of the square is that of Q.

        Parameters
        ----------
        covariance_m2 : (M, M) ndarray
            Covariance of the errors [m²].

        Returns
        -------
        RmsePosterior
            Posterior of their root mean square.

        Examples
        --------
        >>> one = RmsePosterior.of(0.04 * np.ones((3, 3)))
        >>> round(one.expected_m, 3), round(one.upper_m / one.expected_m, 2)
        (0.2, 2.0)
        """
        squared = WeightedChiSquare.of_mean_square(covariance_m2)
        expected = float(np.sqrt(squared.mean))
        relative_sd = float(np.hypot(np.sqrt(squared.variance) / (2.0 * squared.mean), _SCALE_LOG_SD))
        return cls(expected, relative_sd * expected, float(np.sqrt(_upper_m2(squared))))


def _upper_m2(squared: WeightedChiSquare) -> float:
    """Return what a mean square stays below with a probability of 95 %, its size uncertain [m²]."""
    scales = np.exp(2.0 * _SCALE_LOG_SD * (_STANDARD - _SCALE_LOG_SD))

    def missing(value: float) -> float:
        return float(np.mean([squared.below(value / scale) for scale in scales])) - CONFIDENCE

    alone = squared.quantile(CONFIDENCE)
    return float(brentq(missing, alone * scales.min(), alone * scales.max(), xtol=1e-9 * alone))


@dataclass(frozen=True)
class RmseClaim:
    """Posterior of a map's error by its own claim, with the best vertical offset and without.

    Parameters
    ----------
    absolute : RmsePosterior
        Of the errors as they are.
    relative : RmsePosterior
        Of the errors less their mean, which a vertical offset removes.
    offset_sigma_m : float
        Standard deviation of that mean [m].
    untested_share : float
        Share of the ground that lies farther from all points than any point that was left out to test the standard
        deviation; 0 where nothing was left out.
    """

    absolute: RmsePosterior
    relative: RmsePosterior
    offset_sigma_m: float
    untested_share: float = 0.0

    @classmethod
    def of(cls, covariance_m2: FloatArray, std_m: FloatArray) -> Self:
        """Compute the claim of a map from the covariance of its errors, scaled to its stated standard deviations.

        Parameters
        ----------
        covariance_m2 : (M, M) ndarray
            Covariance of the heights at the nodes [m²].
        std_m : (M,) ndarray
            Standard deviations that the map states there [m].

        Returns
        -------
        RmseClaim
            Claim over these nodes.
        """
        scale = std_m / np.sqrt(np.diag(covariance_m2))
        stated = covariance_m2 * np.outer(scale, scale)
        by_row = stated.mean(axis=0)
        centred = stated - by_row[:, None] - by_row[None, :] + by_row.mean()
        return cls(
            RmsePosterior.of(stated), RmsePosterior.of(centred), float(np.sqrt(max(by_row.mean(), 0.0)))
        )

    def facts(self) -> dict[str, Any]:
        """Return the claim for the record of a map.

        Returns
        -------
        dict
            Plain values for JSON.
        """
        return asdict(self)

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> Self:
        """Rebuild a claim from the record of a map.

        Parameters
        ----------
        facts : mapping
            Values of `facts`.

        Returns
        -------
        RmseClaim
            An equal claim.
        """
        absolute, relative = (RmsePosterior(**facts[name]) for name in ("absolute", "relative"))
        return cls(absolute, relative, facts["offset_sigma_m"], facts.get("untested_share", 0.0))


def sampled_nodes(inside: npt.NDArray[np.bool_]) -> IntArray:
    """Return at most 400 evenly spread nodes of a grid, as rows of its nodes in order, among those inside (H, W).

    Examples
    --------
    >>> sampled_nodes(np.ones((40, 40), dtype=bool)).size
    400
    """
    step = max(int(np.ceil(np.sqrt(inside.sum() / _MOST_NODES))), 1)
    first = step // 2
    chosen = np.zeros_like(inside)
    chosen[first::step, first::step] = True
    rows = np.flatnonzero((chosen & inside).ravel())
    return rows if len(rows) else np.flatnonzero(inside.ravel())[:_MOST_NODES]
