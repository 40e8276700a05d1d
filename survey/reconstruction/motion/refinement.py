"""Results of a joint estimate on moving ice: motion of the ice, and mean height over an area.

`refined_motion` returns the posterior of the ice's motion, which the estimate observes through places that were passed
twice. `area_mean` returns the mean height of the map and its standard deviation, for changes of volume and mass between
epochs.
"""

import numpy as np

from survey.core.errors import InputError
from survey.data.grid import Grid
from survey.data.ice_motion import IceMotion
from survey.data.path_error import motion_rows
from survey.reconstruction.joint.solution import JointSolution


def refined_motion(motion: IceMotion, solution: JointSolution) -> IceMotion:
    """Return the motion of the ice after a joint estimate, which sees it through places that were passed twice.

    Parameters
    ----------
    motion : IceMotion
        Motion after localization (`Localization.ice_motion`).
    solution : JointSolution
        Joint estimate of the landmarks of that localization.

    Returns
    -------
    IceMotion
        With the same modes; `motion` itself where the estimate retained modes of the path's error alone.

    Raises
    ------
    InputError
        The path of the estimate has no such unknowns.
    """
    if solution.has_modes:
        return motion
    n, posterior = motion.n_unknowns, solution.posterior
    if solution.path.n_unknowns < len(solution.path) * solution.path.n_states + n:
        raise InputError(
            "the path was not estimated in coordinates of the ice; localize the recording that in_ice_frame returns."
        )
    rows = motion_rows(solution.path, n, len(posterior.shared))
    return motion.updated(rows @ posterior.shared, posterior.shared_covariance(rows))


# Nodes whose covariance is evaluated: every error longer than their distance is counted in full.
_MOST_NODES = 400


def area_mean(solution: JointSolution, grid: Grid) -> tuple[float, float]:
    """Return the mean height of a joint map over the nodes of a grid, and its standard deviation [m].

    The errors of different nodes are correlated by path, fixes and the motion of the ice: a level error does not average
    out.

    Parameters
    ----------
    solution : JointSolution
        Joint estimate at an epoch.
    grid : Grid
        Nodes over the area.

    Returns
    -------
    mean_m : float
        Mean height [m].
    sigma_m : float
        Its standard deviation [m].

    Examples
    --------
    The change between two epochs has the standard deviation ``hypot(sigma_early_m, sigma_late_m)`` where the surveys share
    no receiver error.
    """
    mean, _ = solution.terrain.fields(grid)
    step = max(int(np.ceil(np.sqrt(mean.size / _MOST_NODES))), 1)
    places = grid.xy.reshape(*grid.shape, 2)[::step, ::step].reshape(-1, 2)
    return float(mean.mean()), float(np.sqrt(solution.terrain.covariance(places).mean()))
