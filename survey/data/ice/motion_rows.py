"""Unknowns of the ice's motion among those of a path."""

from typing import Any

import numpy as np
from scipy import sparse

from survey.data.path_error import PathError


def motion_rows(path: PathError, n_unknowns: int, n_columns: int | None = None) -> Any:
    """Return the sparse rows (R, columns) that pick the unknowns of the ice's motion among those of a path.

    Parameters
    ----------
    path : PathError
        Error of a path that was estimated in coordinates of the ice.
    n_unknowns : int
        R; they stand behind the keyframes.
    n_columns : int, optional
        Number of columns; that of the path's unknowns by default.

    Returns
    -------
    scipy.sparse.csr_array
        Rows with a single 1.
    """
    every = np.arange(n_unknowns)
    place = (every, len(path) * path.n_states + every)
    shape = (n_unknowns, path.n_unknowns if n_columns is None else n_columns)
    return sparse.csr_array((np.ones(n_unknowns), place), shape=shape)
