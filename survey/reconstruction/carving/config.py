"""Settings of the space-carving kernels."""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from survey.core.arrays import FloatArray
from survey.core.config import Section

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
