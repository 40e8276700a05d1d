r"""Probability that is asked for at each look of a survey that may stop at any look.

A survey that stops as soon as a probability of 1 - α is reached has many occasions to stop too early. The probability
of error α is therefore spent over the looks (Lan and DeMets 1983, Biometrika 70, 659): at look k = 1, 2, … the survey
stops only where the probability of a miss is at most

.. math::  \alpha_k = \frac{\alpha}{k (k + 1)}, \qquad \sum_{k = 1}^{\infty} \alpha_k = \alpha

so that by Bonferroni's inequality all looks together, however many, miss with a probability of at most α. Whether a
swath is followed by a look has to be settled before it is driven.
"""


def asked_at(probability: float, look: int) -> float:
    """Return the probability that is asked for at a look, so that all looks together give the one that is promised.

    Parameters
    ----------
    probability : float
        Probability that is promised.
    look : int
        Which look it is, from 1.

    Returns
    -------
    float
        Between `probability` and 1.

    Examples
    --------
    >>> round(asked_at(0.9, 1), 3), round(asked_at(0.9, 2), 3), round(asked_at(0.9, 10), 4)
    (0.95, 0.983, 0.9991)
    """
    return 1.0 - (1.0 - probability) / (look * (look + 1))
