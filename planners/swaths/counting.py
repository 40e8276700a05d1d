"""Numbers of lines and pieces of a route."""

import numpy as np

from survey.data.route import Route

_APART_M = 0.01


def count_lines(route: Route) -> int:
    """Return the number of straight lines that the swaths of a route lie on.

    A concave border or no-go ground cuts a line into several swaths.

    Parameters
    ----------
    route : Route
        Its swaths' axes are counted; those on one line to a centimetre count once.

    Returns
    -------
    int
        At most ``len(route.swaths)``.

    Examples
    --------
    >>> from survey import Leg
    >>> legs = (Leg("swath", [[0.0, 0.0], [4.0, 0.0]]), Leg("transit", [[4.0, 0.0], [6.0, 0.0]]),
    ...         Leg("swath", [[6.0, 0.0], [9.0, 0.0]]))
    >>> count_lines(Route(legs, "EPSG:32608", "lawnmower"))
    1
    """
    axes = np.array([swath.axis for swath in route.swaths])
    axes -= axes.mean(axis=(0, 1))
    along = axes[:, 1] - axes[:, 0]
    lengths = np.hypot(*along.T)
    left: list[int] = list(np.argsort(-lengths, kind="stable"))
    n = 0
    while left:
        # The longest axis left gives the direction of its line best.
        first = left[0]
        direction = along[first] / lengths[first]
        normal = np.array([-direction[1], direction[0]])
        off = np.abs((axes[left] - axes[first, 0]) @ normal).max(axis=1)
        left = [index for index, distance in zip(left, off, strict=True) if distance > _APART_M]
        n += 1
    return n


def swaths_text(route: Route) -> str:
    """Return the number of swaths in words, with the number of lines where some are cut into pieces.

    Parameters
    ----------
    route : Route
        A planned route.

    Returns
    -------
    str
        Such as ``"4 swaths"`` or ``"4 lines in 6 pieces"``.
    """
    n_lines, n_pieces = count_lines(route), len(route.swaths)
    if n_lines < n_pieces:
        return f"{n_lines} line{'s' * (n_lines > 1)} in {n_pieces} pieces"
    return f"{n_pieces} swath{'s' * (n_pieces > 1)}"
