"""Memory of a map, estimated before any work starts."""

import math

from survey.core import Bounds, CapacityError, InputError

MAP_MEMORY_MB = 4000.0
"""Memory that the arrays of one map may take [MB]."""
# At a hundredth of a step the correlation of a node with all points but those upon it is below the rounding.
_LEAST_STEPS = 0.01


def require_nodes(
    bounds: Bounds, step_m: float, bytes_per_node: float, memory_mb: float = MAP_MEMORY_MB
) -> None:
    """Refuse a map whose nodes would not fit into memory, and name the smallest step that does.

    `bounds` (xmin, ymin, xmax, ymax): extent of the map [m]. `step_m`: distance between the nodes [m].
    `bytes_per_node`: memory that the method takes for a node [bytes]. `memory_mb`: memory allowed [MB].

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


def require_length_scale(length_m: float | None, step_m: float) -> None:
    """Refuse a length scale far below the step of the map, with which no point would reach a node.

    `length_m`: shortest length scale that the settings state [m]. `step_m`: distance between the nodes of the
    map [m].

    >>> require_length_scale(17.75, 2.0)
    >>> require_length_scale(1e-9, 2.0)
    Traceback (most recent call last):
    survey.core.errors.InputError: the kernel's length scale of 1e-09 m is ...
    """
    least_m = _LEAST_STEPS * step_m
    if length_m is not None and length_m < least_m:
        raise InputError(
            f"the kernel's length scale of {length_m:g} m is less than a hundredth of the map's step of {step_m:g} m, so "
            f"that no point would reach a node; set length_scale_m to {least_m:g} m or more."
        )


def smallest_step_m(width_m: float, height_m: float, most_nodes: float, spare_nodes: float = 1.0) -> float:
    """Return the smallest step, to three digits, at which a rectangle has no more nodes than allowed [m].

    `width_m`, `height_m`: sides of the rectangle [m]. Returns: the step [m].

    >>> smallest_step_m(99.0, 99.0, 10_000)
    1.0
    """
    # (w / s + k) (h / s + k) = n, solved for s
    a = most_nodes - spare_nodes**2
    b, c = spare_nodes * (width_m + height_m), width_m * height_m
    return rounded_up((b + math.sqrt(b * b + 4.0 * a * c)) / (2.0 * a))


def rounded_up(value: float) -> float:
    """Return a positive number rounded up to three digits.

    >>> rounded_up(0.012341)
    0.0124
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / unit - 1e-6) * unit:.12g}")
