"""Results of a joint estimate on moving ice: motion of the ice, and mean height over an area.

`refined_motion` returns the posterior of the ice's motion, which the estimate observes through places that were passed
twice. `area_mean` returns the mean height of the map and its standard deviation, for changes of volume and mass between
epochs.
"""

from typing import TYPE_CHECKING

import numpy as np

from survey.core import InputError
from survey.data import Grid, IceMotion
from survey.data.path_error import motion_rows
from survey.reconstruction.motion.epoch import at_epoch, with_age
from survey.reconstruction.terrain_map import Reconstruction

if TYPE_CHECKING:
    from survey.reconstruction.joint.solution import JointSolution


def on_ice(
    result: Reconstruction, motion: IceMotion, solution: "JointSolution", epoch_s: float | None
) -> tuple[Reconstruction, IceMotion]:
    """Return a joint map with its age, or moved to an epoch in seconds of the recording, and the refined motion of the ice."""
    refined = refined_motion(motion, solution)
    if epoch_s is None:
        return with_age(result, refined), refined
    return at_epoch(result, refined, epoch_s)


def refined_motion(motion: IceMotion, solution: "JointSolution") -> IceMotion:
    """Return the motion of the ice after a joint estimate, which sees it through places that were passed twice."""
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


def area_mean(solution: "JointSolution", grid: Grid) -> tuple[float, float]:
    """Return the mean height of a joint map over the nodes of a grid, and its standard deviation [m].

    The errors of different nodes are correlated by path, fixes and the motion of the ice: a level error does not average
    out.

    Returns `mean_m`: mean height [m]. `sigma_m`: its standard deviation [m].

    The change between two epochs has the standard deviation ``hypot(sigma_early_m, sigma_late_m)`` where the surveys share
    no receiver error.
    """
    mean, _ = solution.terrain.fields(grid)
    step = max(int(np.ceil(np.sqrt(mean.size / _MOST_NODES))), 1)
    places = grid.xy.reshape(*grid.shape, 2)[::step, ::step].reshape(-1, 2)
    return float(mean.mean()), float(np.sqrt(solution.terrain.covariance(places).mean()))
