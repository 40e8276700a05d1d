"""Memory of space-carving kernels, estimated before they learn."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError
from survey.reconstruction.capacity import rounded_up
from survey.reconstruction.carving.config import SpaceCarvingConfig

_BYTES_PER_NODE, _BYTES_PER_CELL, _BYTES_PER_POINT = 24.0, 16.0, 700.0
# Nodes per length scale of the raster that holds all passes.
_NODES_OF_LAST = 4.0
_N_HALVINGS = 60


def raster_step_m(lengths_m: FloatArray) -> float:
    """Return the step of the raster on which lines of sight are searched [m]."""
    return float(lengths_m[-1]) / _NODES_OF_LAST


def needed_mb(config: SpaceCarvingConfig, width_m: float, height_m: float, n_points: int) -> float:
    """Return the memory that kernels over a frame of this size take [MB]."""
    n_surfaces = 3 if config.bounds else 1
    lengths_m = config.lengths_m()
    step_m = raster_step_m(lengths_m)
    nodes = (np.ceil(height_m / step_m) + 2.0) * (np.ceil(width_m / step_m) + 2.0) if config.carve else 0.0
    cells = ((np.floor(width_m / lengths_m) + 3.0) * (np.floor(height_m / lengths_m) + 3.0)).sum()
    needed = _BYTES_PER_NODE * nodes + _BYTES_PER_CELL * cells + _BYTES_PER_POINT * n_points
    return float(n_surfaces * needed / 1e6)


def require_room(config: SpaceCarvingConfig, width_m: float, height_m: float, n_points: int) -> None:
    """Refuse ground and points that would not fit the memory allowed, and name the length scale that does."""
    needed = needed_mb(config, width_m, height_m, n_points)
    if needed > config.memory_mb:
        raise CapacityError(
            f"a map of {width_m:.0f} × {height_m:.0f} m and {n_points} points with last_length_m = {config.last_length_m:g} takes "
            f"{needed:.6g} MB of the {config.memory_mb:g} MB allowed; {_remedy(config, width_m, height_m, n_points)}."
        )


def _remedy(config: SpaceCarvingConfig, width_m: float, height_m: float, n_points: int) -> str:
    """Return the smallest last length scale that fits, as an instruction; fewer points where none does."""
    low, high = config.last_length_m, max(width_m, height_m)

    def fits(last_m: float) -> bool:
        longer = _with_last(config, last_m)
        # The frame reaches a first length scale beyond the points, and begins on a node of the raster.
        wider = 2.0 * (longer.first_length_m - config.first_length_m) + raster_step_m(longer.lengths_m())
        return needed_mb(longer, width_m + wider, height_m + wider, n_points) <= config.memory_mb

    if not fits(high):
        return "cut the points, or allow more memory"
    for _ in range(_N_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if fits(middle) else (middle, high)
    least_m = rounded_up(high)
    first = f" and first_length_m = {least_m:g}" if least_m > config.first_length_m else ""
    return f"set last_length_m = {least_m:g}{first} or more, or cut the points"


def _with_last(config: SpaceCarvingConfig, last_m: float) -> SpaceCarvingConfig:
    """Return the settings with another last length scale, and a first one that is no shorter."""
    first_m = max(config.first_length_m, last_m)
    return config.model_copy(update={"last_length_m": last_m, "first_length_m": first_m})
