"""Posterior of the delay of fixes whose clock may or may not be that of the images."""

import numpy as np

_ONE_CLOCK = 0.35  # prior probability that the clocks agree
_AGREE_S = 2e-3  # error of clocks that agree
_DOUBTFUL = 0.01  # posterior probability that they agree above which a delay is not corrected
_BEYOND = 2.5  # standard deviations of the prior, beyond which errors of the odometry pass for a delay


def delay_moments(delay_s: float, delay_sigma_s: float, clock_sigma_s: float) -> tuple[float, float]:
    r"""Return the mean and the standard deviation of a delay under a mixture prior.

    Most recordings have one clock, and some have two. With the prior

    .. math:: p(τ) = 0.35 N(τ; 0, 2\ \mathrm{ms}) + 0.65 N(τ; 0, σ)

    and a likelihood of τ that is normal, the posterior is a mixture of two normal distributions. Where the
    clocks agree with a posterior probability of more than 0.01, the delay is not corrected: its mean is 0,
    and its standard deviation the root of the second moment. A delay beyond 2.5 σ is none: an odometry that
    contradicts the fixes passes for one, and the prior is left as it is.

    Parameters
    ----------
    delay_s, delay_sigma_s : float
        Mean and standard deviation of the delay under the second part of the prior alone [s].
    clock_sigma_s : float
        Its standard deviation σ [s].

    Returns
    -------
    mean_s, sigma_s : float
        Mean and standard deviation of the delay [s].

    Examples
    --------
    Where the records say nothing, the variance is 0.65 of that of the second part:

    >>> mean_s, sigma_s = delay_moments(0.0, 0.4, 0.4)
    >>> round(mean_s, 3), round(sigma_s, 3)
    (0.0, 0.322)

    A delay that is well determined stays as it is:

    >>> mean_s, sigma_s = delay_moments(0.5, 0.02, 0.4)
    >>> round(mean_s, 3), round(sigma_s, 3)
    (0.5, 0.02)
    """
    information = max(delay_sigma_s**-2.0 - clock_sigma_s**-2.0, 1e-9)
    likely_s = delay_s * delay_sigma_s**-2.0 / information
    priors = np.array([_AGREE_S, clock_sigma_s]) ** 2
    spread = priors + 1.0 / information
    log_weight = np.log([_ONE_CLOCK, 1.0 - _ONE_CLOCK]) - 0.5 * (np.log(spread) + likely_s**2 / spread)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    means, variances = likely_s * priors / spread, priors / information / spread
    if abs(likely_s) > _BEYOND * clock_sigma_s and information > clock_sigma_s**-2.0:
        return 0.0, float(np.sqrt((1.0 - _ONE_CLOCK) * clock_sigma_s**2))
    second_moment = float(weight @ (variances + means**2))
    mean_s = 0.0 if weight[0] > _DOUBTFUL else float(weight @ means)
    return mean_s, float(np.sqrt(second_moment - mean_s**2))
