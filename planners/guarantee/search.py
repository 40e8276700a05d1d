"""Search for the smallest number that is enough, and the numbers of swaths that are tried."""

from collections.abc import Callable

import numpy as np

from planners.guarantee.requirement import MapRequirement

_MOST_SWATHS = 30
_WIDEST_CELLS = 5.0


def fewest(is_enough: Callable[[int], bool], *, first: int, most: int) -> int | None:
    """Return the smallest number from 1 to `most` that is enough, sought from `first` on; None where none is.

    Examples
    --------
    >>> fewest(lambda n: n >= 7, first=5, most=30)
    7
    """
    low, high, step = 0, min(max(first, 1), most), 1
    if is_enough(high):
        while high - step > low:
            if not is_enough(high - step):
                low = high - step
                break
            high, step = high - step, 2 * step
    else:
        while not is_enough(high):
            if high >= most:
                return None
            low, high, step = high, min(high + step, most), 2 * step
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return high


def swath_counts(width_m: float, cell_m: float, requirement: MapRequirement) -> tuple[int, ...]:
    """Return the numbers of swaths that are considered, from the least coverage to the most.

    Swaths are at most five cells of the prior apart, for relief that is longer is all that the prior shows well, and
    at least two samples, or 30 of them on a narrow area. Beyond fifteen, numbers grow by a tenth.

    Parameters
    ----------
    width_m : float
        Width of the area across the swaths [m].
    cell_m : float
        Width of a cell of the prior [m].
    requirement : MapRequirement
        Its distance between samples and its largest number of swaths are used.

    Returns
    -------
    tuple of int
        In rising order, at least one.

    Examples
    --------
    >>> swath_counts(600.0, 30.0, MapRequirement(0.4572, max_swaths=16))
    (4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16)
    """
    dense = max(_MOST_SWATHS, int(width_m / (2.0 * requirement.sample_step_m)))
    most = requirement.max_swaths or dense
    counts = [min(max(int(np.ceil(width_m / (_WIDEST_CELLS * cell_m))), 2), most)]
    while counts[-1] < most:
        counts.append(min(max(counts[-1] + 1, round(1.1 * counts[-1])), most))
    return tuple(counts)
