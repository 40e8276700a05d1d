"""Places over an area at which predicted maps are judged."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea

# The plastic number, whose powers spread places evenly over the plane (Roberts 2018).
_PLASTIC = 1.324717957244746
_MOST_DRAWN = 100
"""Places drawn for each one wanted, at most: the bounds of a thin area hold little of it."""


def spread_places(area: SurveyArea, n: int) -> FloatArray:
    """Return places that are spread evenly over the free ground, in no step with any swaths.

    Places on a square grid would all lie on swaths, or all between them, where the swaths are as far apart as the nodes.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    n : int
        About how many places.

    Returns
    -------
    (M, 2) ndarray
        Easting and northing [m]; any first part of them is spread evenly.

    Raises
    ------
    InputError
        No place lies on the free ground.

    Examples
    --------
    >>> spread_places(SurveyArea.rectangle((0.0, 0.0, 20.0, 10.0), "EPSG:32608"), 2).round(1).tolist()
    [[5.1, 0.7], [0.2, 6.4]]
    """
    low, high = np.array(area.bounds[:2]), np.array(area.bounds[2:])
    drawn = min(int(n * np.prod(high - low) / max(area.free.area, 1e-9)), _MOST_DRAWN * n)
    share = (0.5 + np.arange(1, drawn + 1)[:, None] / _PLASTIC ** np.array([1, 2])) % 1.0
    places = low + share * (high - low)
    inside: FloatArray = places[area.contains(places)]
    if not len(inside):
        raise InputError("the area is so thin that no node of its map lies on free ground; widen it.")
    return inside
