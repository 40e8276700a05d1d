"""Motion of the ice after a joint estimate of map and path."""

from survey.core.errors import InputError
from survey.data.ice.motion import IceMotion
from survey.data.ice.motion_rows import motion_rows
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
