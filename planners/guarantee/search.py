"""Search for the smallest number that is enough."""

from collections.abc import Callable


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
