"""Settings of the space-carving kernels, and the memory that they take.

`needed_mb` estimates the memory from the extent, the length scales and the number of points; `require_kernel_memory` refuses what
would not fit before any work starts, and names the smallest length scale that does.
"""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from survey.core import CapacityError, FloatArray, Section
from survey.reconstruction.capacity import rounded_up

_LEAST_THIN_M = 1e-3


class SpaceCarvingConfig(Section):
    """How space-carving kernels learn; where the paper gives no number, our choice is stated.

    Examples
    --------
    >>> SpaceCarvingConfig(n_epochs=3).lengths_m().round(2)
    array([5.  , 1.41, 0.4 ])
    """

    carve: bool = True
    """Whether lines of sight carve the surface; without, points alone make it."""
    bounds: bool = True
    """Whether an upper and a lower surface are learned as well, which takes three times as long."""
    n_epochs: int = Field(default=8, ge=1, le=64)
    """Most passes over the points; each has a length scale of its own."""
    first_length_m: float = Field(default=5.0, gt=0)
    """Length scale of the kernel in the first pass [m]; 5 m as in the paper."""
    last_length_m: float = Field(default=0.4, gt=0)
    """Length scale in the last pass [m], by equal factors from the first; the paper gives none."""
    rate: float = Field(default=0.5, gt=0, le=1)
    """Learning rate η₀ at the first step; it falls as t^(-1/2) after four passes' worth of steps."""
    ray_rate: float = Field(default=1.0, gt=0, le=1)
    """Learning rate of lines of sight, which does not fall; 1 takes a violation back whole. The paper has one rate for both."""
    decay: float = Field(default=1e-6, ge=0, lt=1)
    """Weight decay λ."""
    dead_band_m: float = Field(default=0.03, ge=0)
    """Violations below this make no basis [m]; 0.1 gives about as few bases as the paper reports."""
    ray_sigmas: float = Field(default=3.0, ge=0)
    """A line of sight may run so many of its point's standard deviations under the surface, if that is more than the dead-band."""
    prior_m: float | None = None
    """Height of the surface before the first point [m]; left out, the points' median."""
    bound_offset_m: float = Field(default=5.0, gt=0)
    """How far above and below that the upper and the lower surface begin [m]."""
    gate: bool = True
    """Whether isolated points are rejected.

    Left out are points far from all their neighbours in the scan, and their rays with them; rays that end
    far below the surface carve nothing, and no ray carves more than 0.2 m below the third-lowest over a cell."""
    thin_m: float = Field(default=0.0, ge=0)
    """Of the points of an update in one cell of this side, only the first is taken [m]; 0 for all.

    The cost of a pass grows with the points times the points in a kernel's reach."""
    gradient_tolerance_m: float = Field(default=0.0, ge=0)
    """The passes end once the mean violation is below this [m]."""
    validation_share: float = Field(default=0.0, ge=0, lt=0.5)
    """Share of the points held back; the passes end once the error there grows. 0 for none."""
    memory_mb: float = Field(default=4000.0, gt=0)
    """Memory that a map may take [MB]."""
    seed: int = Field(default=0, ge=0)
    """Of the order in which points are visited."""

    @model_validator(mode="after")
    def _falling(self) -> Self:
        if self.last_length_m > self.first_length_m:
            raise ValueError("last_length_m must not exceed first_length_m")
        if 0.0 < self.thin_m < _LEAST_THIN_M:
            raise ValueError(f"thin_m must be 0, or {_LEAST_THIN_M:g} or more")
        return self

    def lengths_m(self) -> FloatArray:
        """Return the length scale of every pass [m].

        Returns
        -------
        (P,) ndarray
            Length scales [m], in the order of the passes.
        """
        lengths: FloatArray = np.geomspace(self.first_length_m, self.last_length_m, self.n_epochs)
        return lengths


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


def require_kernel_memory(config: SpaceCarvingConfig, width_m: float, height_m: float, n_points: int) -> None:
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
