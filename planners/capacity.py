"""Sizes that planning accepts, checked before work starts.

Each limit keeps a plan within about 2 GB and a few minutes on two cores.
"""

from survey import CapacityError

MOST_LINES = 8_000
"""Swaths over an area: the table of transits takes 16 n² bytes, so that this many fill one gigabyte."""
MOST_WAYPOINTS = 2_000_000
"""Waypoints of wavy or steered swaths."""
MOST_SAMPLES = 8_000
"""Samples whose covariance matrix is factorized: 8 n² bytes, half a gigabyte."""
MOST_PLACES = 5_000_000
"""Samples that are listed along a route."""
MOST_CELLS = 16_000_000
"""Cells of a prior over the area; their slopes take about a gigabyte."""
MOST_NODES = 40_000
"""Nodes of a predicted map."""
MOST_ROVERS = 100


def require_lines(n: int, width_m: float) -> None:
    """Refuse more parallel swaths than can be planned.

    `width_m`: width of the ground across them [m].

    >>> require_lines(100, 600.0)
    """
    if n > MOST_LINES:
        raise CapacityError(
            f"{n} swaths over a width of {width_m:.6g} m were asked for; at most {MOST_LINES} can be planned, "
            f"{width_m / MOST_LINES:.3g} m apart: widen the spacing or split the area."
        )


def require_waypoints(n: float, name: str, value: float) -> None:
    """Refuse a setting that leads to more waypoints than can be held.

    `value`: its value [m].
    """
    if n > MOST_WAYPOINTS:
        raise CapacityError(
            f"{name} = {value:g} m gives {n:.3g} waypoints; at most {MOST_WAYPOINTS} can be planned, "
            f"which takes at least {1.01 * value * n / MOST_WAYPOINTS:.3g} m."
        )


def require_samples(length_m: float, step_m: float, most: int = MOST_PLACES) -> None:
    """Refuse a sample spacing that gives more samples than can be computed with.

    `length_m`: length of the route [m]. `step_m`: distance between samples [m].
    """
    if length_m > most * step_m:
        raise CapacityError(
            f"a sample every {step_m:g} m along {length_m:.6g} m gives {length_m / step_m:.3g} samples; at most {most} can be "
            f"used: take a sample spacing of at least {1.01 * length_m / most:.3g} m."
        )


def require_cells(n_cells: int) -> None:
    """Refuse a prior with more cells over the area than can be computed with."""
    if n_cells > MOST_CELLS:
        raise CapacityError(
            f"the prior has {n_cells} cells over the area; at most {MOST_CELLS} can be used: take cells at least "
            f"{(n_cells / MOST_CELLS) ** 0.5:.2g} times as wide, or a smaller area."
        )


def require_error_nodes(n_nodes: float, cell_m: float) -> None:
    """Refuse a predicted map with more nodes than can be computed.

    `cell_m`: distance between them [m].
    """
    if n_nodes > MOST_NODES:
        raise CapacityError(
            f"cells of {cell_m:g} m give {n_nodes:.3g} nodes of the predicted map; at most {MOST_NODES} can be computed: "
            f"take cells of at least {1.01 * cell_m * (n_nodes / MOST_NODES) ** 0.5:.3g} m."
        )


def require_rovers(n: int) -> None:
    """Refuse a fleet that is too large."""
    if n > MOST_ROVERS:
        raise CapacityError(
            f"{n} rovers were asked for; at most {MOST_ROVERS} can be planned, split the area."
        )
