"""Settings of the lattices."""

from typing import Self

from pydantic import Field, model_validator

from survey.core import Section

NODE_STEP_M = 0.25
"""Distance between the nodes of a lattice where none is stated: 16 nodes per square metre [m]."""
# A draw is a 32-bit number.
_BYTES_OF_FIELD, _BYTES_PER_DRAW = 230.0, 4.0


class FieldLatticeConfig(Section):
    """How a field lattice maps scans; the defaults learn the ground's stiffness while running.

    Examples
    --------
    >>> FieldLatticeConfig(stiffness=400.0, range_m=20.0).learns
    False
    """

    step_m: float | None = Field(default=None, gt=0)
    """Distance between the nodes [m]; that of the map, or 0.25 m, when left out."""
    stiffness: float | None = Field(default=None, gt=0)
    """Stiffness κ of the ground; learned when left out."""
    range_m: float | None = Field(default=None, gt=0)
    """Distance over which heights about the plane are alike [m]; learned with the stiffness, else without end."""
    edge_preserving: bool = False
    """Whether sharp bends cost less than a plate's would: for steps, walls and piles."""
    gate: bool = True
    """Whether points far from all their neighbours in the scan are left out."""
    rays: bool = False
    """Whether lines of sight hold the surface down and bound it; the points then need origins."""
    side_m: float | None = Field(default=None, gt=0)
    """Side of a map that follows the sensor [m]; left out, the map grows with the points and drops nothing."""
    window_nodes: int | None = Field(default=None, ge=16)
    """Solve only so many nodes a side about the sensor at every update; left out, all."""
    n_draws: int = Field(default=32, ge=0, le=64)
    """Draws from which the standard deviation of a large map is taken; 0 for none."""
    calibrate: bool = True
    """Whether blocks of points that are left out scale the standard deviation."""
    tolerance: float = Field(default=0.1, gt=0)
    """Bound of the solver's error at any node, in its posterior standard deviations; the usual error is far smaller."""
    memory_mb: float = Field(default=4000.0, gt=0)
    """Memory that a map may take [MB]."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.stiffness is None and self.range_m is not None:
            raise ValueError(
                "range_m is learned together with the stiffness; give both or only the stiffness"
            )
        return self

    @property
    def node_step_m(self) -> float:
        """Distance between the nodes [m], 0.25 m unless stated."""
        return self.step_m or NODE_STEP_M

    @property
    def bytes_per_node(self) -> float:
        """Memory of a node: stencil, right-hand side, heights, the solver's work, and the draws [bytes]."""
        return _BYTES_OF_FIELD + _BYTES_PER_DRAW * self.n_draws

    @property
    def learns(self) -> bool:
        """Whether the stiffness is learned."""
        return self.stiffness is None


class SpringLatticeConfig(Section):
    """How a spring lattice (EMap) maps scans.

    Examples
    --------
    >>> SpringLatticeConfig().side_m
    20.0
    """

    step_m: float | None = Field(default=None, gt=0)
    """Distance between the nodes [m]; that of the map, or 0.25 m as in the paper, when left out."""
    side_m: float | None = Field(default=20.0, gt=0)
    """Side of the lattice that follows the sensor [m], twice its range; left out, the lattice grows with the points."""
    k_surface: float = Field(default=1.0, gt=0)
    """Constant of the springs between nodes."""
    k_data: float = Field(default=0.5, gt=0)
    """Constant of the springs to the points."""
    tolerance: float = Field(default=1e-2, gt=0)
    """Largest error of the solver, in standard deviations of a node whose points err by `sigma` / √k_data."""
    memory_mb: float = Field(default=4000.0, gt=0)
    """Memory that a map may take [MB]."""

    @property
    def node_step_m(self) -> float:
        """Distance between the nodes [m], 0.25 m unless stated."""
        return self.step_m or NODE_STEP_M
