"""Mean height of a map over an area with its standard deviation, for changes of volume and mass between epochs."""

import numpy as np

from survey.data.grid import Grid
from survey.reconstruction.joint.solution import JointSolution

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
