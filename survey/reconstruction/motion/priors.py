"""Priors of the ice's motion: the same everywhere, from the slope of the surface, or from a velocity raster."""

import numpy as np

from survey.data.ice.motion import IceMotion


def uniform_motion(
    velocity: tuple[float, float],
    lowering: float,
    *,
    velocity_sigma: float,
    lowering_sigma: float,
    epoch_s: float,
    origin_m: tuple[float, float] = (0.0, 0.0),
    velocity_change_sigma: float = 0.0,
) -> IceMotion:
    """Return a motion that is the same everywhere, with independent errors.

    Parameters
    ----------
    velocity : (float, float)
        To the east and to the north [m/day].
    lowering : float
        Rate of lowering [m/day].
    velocity_sigma, lowering_sigma : float
        Standard deviations [m/day]; 0 for what is exact.
    epoch_s : float
        Epoch [s].
    origin_m : (float, float)
        Origin of the planes [m].
    velocity_change_sigma : float
        Standard deviation of the change of velocity over a kilometre [m/day/km]; 0 leaves the planes out.

    Returns
    -------
    IceMotion
        Lowering has no planes.

    Examples
    --------
    >>> uniform_motion((2.0, 0.0), 0.1, velocity_sigma=0.5, lowering_sigma=0.0, epoch_s=0.0).n_unknowns
    2
    """
    m = 3 if velocity_change_sigma > 0.0 else 1
    coefficients, sigma = np.zeros((3, m)), np.zeros((3, m))
    coefficients[:, 0] = (*velocity, lowering)
    sigma[:2, 1:] = velocity_change_sigma
    sigma[:, 0] = (velocity_sigma, velocity_sigma, lowering_sigma)
    return IceMotion.of(
        coefficients, np.diag(sigma.ravel() ** 2), epoch_s=epoch_s, origin_m=np.asarray(origin_m, dtype=float)
    )
