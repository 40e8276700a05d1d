"""Order of recorded messages by their time stamps."""

from collections.abc import Sequence

import numpy as np

from survey.core.arrays import BoolArray

# Share of messages that may be older than one before.
_MOST_LATE = 0.1


def in_order(time_s: Sequence[float]) -> BoolArray:
    """Return which messages are later than all before them; every one where more than a tenth goes back in time.

    Drivers publish the same reading twice, and networks deliver late messages. Times of a clock that was set back are
    left as they are: no message is in its place then.

    Parameters
    ----------
    time_s : sequence of float
        Time stamps in the order of the recording [s].

    Returns
    -------
    (N,) ndarray of bool
        Which messages to use.

    Examples
    --------
    >>> in_order([1.0, 2.0, 2.0, 3.0]).tolist()
    [True, True, False, True]
    >>> in_order([9.0, 1.0, 2.0]).tolist()
    [True, True, True]
    """
    times = np.asarray(time_s, dtype=np.float64)
    latest = np.maximum.accumulate(np.r_[-np.inf, times])[:-1]
    if np.count_nonzero(times < latest) > _MOST_LATE * len(times):
        return np.ones(len(times), dtype=np.bool_)
    later: BoolArray = times > latest
    return later
