"""Read-only arrays of a stated shape, and aliases of array types."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from survey.core.errors import InputError

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
Bounds = tuple[float, float, float, float]
"""West, south, east and north [m]."""
Progress = Callable[[str, int, int], None]
"""Progress callback: what is being done, how many of it are done, and how many there are."""


def frozen(values: Any, dtype: Any = np.float64) -> Any:
    """Return a read-only copy in C order.

    Parameters
    ----------
    values : array_like
        Numbers of any shape.
    dtype : dtype
        Type of the copy.

    Returns
    -------
    ndarray
        A copy that cannot be written to.
    """
    array = np.array(values, dtype=dtype, order="C")
    array.flags.writeable = False
    return array


def lattice_places(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return every pair of an easting and a northing, row by row.

    Parameters
    ----------
    x : (W,) ndarray
        Eastings of the columns.
    y : (H,) ndarray
        Northings of the rows.

    Returns
    -------
    (H * W, 2) ndarray
        Easting and northing.

    Examples
    --------
    >>> lattice_places(np.array([0.0, 1.0]), np.array([5.0])).tolist()
    [[0.0, 5.0], [1.0, 5.0]]
    """
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def checked(values: Any, shape: Sequence[int | None], what: str) -> FloatArray:
    """Return a read-only float array; refuse another shape, NaN and infinity.

    ``None`` in `shape` stands for any length.

    Parameters
    ----------
    values : array_like
        Numbers.
    shape : sequence of int or None
        Expected lengths; None stands for any.
    what : str
        What they are, for the message.

    Returns
    -------
    ndarray
        A read-only copy.
    """
    try:
        array: FloatArray = frozen(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} are not numbers ({error}); give an array of floats.") from error
    wanted = "(" + ", ".join("N" if n is None else str(n) for n in shape) + ")"
    if array.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=True)
    ):
        raise InputError(f"{what} have the shape {array.shape}; {wanted} was expected.")
    if not np.isfinite(array).all():
        n_bad = int((~np.isfinite(array)).sum())
        raise InputError(
            f"{what} hold {n_bad} values that are NaN or infinite; remove or correct them first."
        )
    return array
