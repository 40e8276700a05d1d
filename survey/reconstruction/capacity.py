"""Memory of a map, estimated before any work starts."""

import math

from survey.core.arrays import Bounds
from survey.core.errors import CapacityError, InputError

MAP_MEMORY_MB = 4000.0
"""Memory that the arrays of one map may take [MB]."""


def require_nodes(
    bounds: Bounds, step_m: float, bytes_per_node: float, memory_mb: float = MAP_MEMORY_MB
) -> None:
    """Refuse a map whose nodes would not fit into memory, and name the smallest step that does.

    Parameters
    ----------
    bounds : (xmin, ymin, xmax, ymax)
        Extent of the map [m].
    step_m : float
        Distance between the nodes [m].
    bytes_per_node : float
        Memory that the method takes for a node [bytes].
    memory_mb : float
        Memory allowed [MB].

    Raises
    ------
    InputError
        A step that is not greater than 0.
    CapacityError
        More memory is needed than allowed.

    Examples
    --------
    >>> require_nodes((0.0, 0.0, 600.0, 600.0), 1.0, 120.0)
    >>> require_nodes((0.0, 0.0, 600.0, 600.0), 0.01, 120.0)
    Traceback (most recent call last):
    survey.core.errors.CapacityError: a map of 600 × 600 m at 0.01 m has 3.6e+09 nodes, ...
    """
    if not (math.isfinite(step_m) and step_m > 0.0):
        raise InputError(f"the grid's step is {step_m:g} m; it must be greater than 0.")
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    n_nodes = (width / step_m + 1.0) * (height / step_m + 1.0)
    needed_mb = bytes_per_node * n_nodes / 1e6
    if needed_mb > memory_mb:
        smallest = smallest_step_m(width, height, memory_mb * 1e6 / bytes_per_node)
        raise CapacityError(
            f"a map of {width:.6g} × {height:.6g} m at {step_m:g} m has {n_nodes:.3g} nodes, which take "
            f"{needed_mb:.3g} MB of the {memory_mb:g} MB allowed; take a step of {smallest:g} m or more, or a smaller "
            "area."
        )


def smallest_step_m(width_m: float, height_m: float, most_nodes: float) -> float:
    """Return the smallest step, to three digits, at which a rectangle has no more nodes than allowed [m].

    Parameters
    ----------
    width_m, height_m : float
        Sides of the rectangle [m].
    most_nodes : float
        Number of nodes allowed.

    Returns
    -------
    float
        The step [m].

    Examples
    --------
    >>> smallest_step_m(99.0, 99.0, 10_000)
    1.0
    """
    # (w / s + 1) (h / s + 1) = n, solved for s
    a, b, c = most_nodes - 1.0, width_m + height_m, width_m * height_m
    step = (b + math.sqrt(b * b + 4.0 * a * c)) / (2.0 * a)
    unit = 10.0 ** (math.floor(math.log10(step)) - 2)
    return float(f"{math.ceil(step / unit - 1e-6) * unit:.12g}")
