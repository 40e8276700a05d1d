"""Ordering of swaths and their connection by transits on free ground."""

from collections.abc import Sequence
from typing import Any

from planners.driving.swath_tours import Tours
from planners.driving.turns import Turning
from planners.ground.transit import FreeGround
from survey.core.arrays import FloatArray
from survey.data.route import Leg


def connect(
    swaths: Sequence[FloatArray],
    ground: FreeGround,
    *,
    start: Any = None,
    end: Any = None,
    axes: Sequence[FloatArray] | None = None,
    turning: Turning | None = None,
    rover: int = 0,
) -> tuple[Leg, ...]:
    """Order the swaths and join them by the shortest transits that stay on the free ground.

    The swaths form a tour whose transits are as short as a local search finds them
    (2-opt and or-opt with turned swaths, then random double bridges; Lourenço et al.
    2003), each transit measured along its true detour. It is no proven optimum; on
    sites with many no-go zones it stays a few percent above the best known tours.

    Parameters
    ----------
    swaths : list of (N, 2) ndarray
        Straight or winding, each on free ground [m].
    ground : FreeGround
        Where rovers may be.
    start, end : (2,) array_like, optional
        Where the rover starts and has to finish [m]; anywhere by default.
    axes : sequence of (2, 2) ndarray, optional
        The straight line that each swath deviates from [m]; its first and last point by default.
    turning : Turning, optional
        Curved transits for a rover that cannot pivot; swaths then need room at their
        ends, so lay them with an inset of about twice the radius.
    rover : int
        Who drives the legs.

    Returns
    -------
    tuple of Leg
        Swaths and transits in driving order. Without a `start`, a site that is swept
        best in the given order begins with the first swath in its given direction.

    Raises
    ------
    InputError
        No swaths, a start or end off the free ground, or swaths that no way joins;
        the message names the part of the ground that is cut off. A turn for which the
        ground leaves no room.

    Examples
    --------
    >>> import numpy as np
    >>> import shapely
    >>> ground = FreeGround(shapely.box(0.0, 0.0, 40.0, 100.0))
    >>> lines = [np.array([[x, 0.0], [x, 100.0]]) for x in (10.0, 30.0)]
    >>> [leg.kind for leg in connect(lines, ground)]
    ['swath', 'transit', 'swath']
    """
    tour = Tours(swaths, ground, [(start, end)], axes=axes, turning=turning)
    return tour.driven(rover)
