"""Regular grids of nodes on which terrain is reconstructed."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from affine import Affine
from pyproj import CRS

from survey.core.arrays import DataObject, FloatArray, checked, frozen, lattice_places
from survey.core.crs import projected_crs, refuse_far
from survey.core.errors import InputError


@dataclass(frozen=True, repr=False)
class Grid(DataObject):
    """Nodes at equal steps over a rectangle, the ends included.

    A raster on this grid has one cell centred on each node; its first row is the
    northern one.

    Parameters
    ----------
    bounds : (4,) sequence of float
        ``(xmin, ymin, xmax, ymax)`` of the outermost nodes [m].
    step_m : float
        Distance between neighbouring nodes [m].
    crs : str or pyproj.CRS
        Projected, in metres.

    Raises
    ------
    InputError
        Empty or reversed bounds, a step that is not positive or does not divide both
        sides, a CRS in degrees.

    Examples
    --------
    >>> Grid(bounds=(0.0, 0.0, 600.0, 600.0), step_m=1.0, crs="EPSG:32608").shape
    (601, 601)
    """

    bounds: tuple[float, float, float, float]
    step_m: float
    crs: CRS = field(default_factory=lambda: CRS("EPSG:32608"))

    def __post_init__(self) -> None:
        xmin, ymin, xmax, ymax = checked(self.bounds, (4,), "the grid's bounds").tolist()
        crs: Any = self.crs
        object.__setattr__(self, "bounds", (xmin, ymin, xmax, ymax))
        object.__setattr__(self, "crs", projected_crs(crs, "the grid"))
        if not (np.isfinite(self.step_m) and self.step_m > 0):
            raise InputError(f"the grid's step is {self.step_m} m; it must be greater than 0.")
        if xmax <= xmin or ymax <= ymin:
            raise InputError(
                f"the grid's bounds {self.bounds} enclose nothing, as around points on one line; name the ground with --area, or give "
                "(xmin, ymin, xmax, ymax)."
            )
        refuse_far(self.bounds, "the grid's bounds")
        for side in (xmax - xmin, ymax - ymin):
            steps = side / self.step_m
            if abs(steps - round(steps)) > 1e-6:
                raise InputError(
                    f"a side of the grid measures {side:g} m, which is no whole number of {self.step_m:g} m steps; change one of the two."
                )

    @classmethod
    def over(cls, bounds: tuple[float, float, float, float], step_m: float, crs: Any) -> Self:
        """Return the smallest grid from the south-west corner on that covers the bounds.

        Parameters
        ----------
        bounds : (4,) tuple of float
            ``(xmin, ymin, xmax, ymax)`` to cover [m].
        step_m : float
            Distance between neighbouring nodes [m].
        crs : str or pyproj.CRS
            Projected, in metres.

        Returns
        -------
        Grid
            Beyond the bounds by less than a step to the east and north.

        Examples
        --------
        >>> Grid.over((0.0, 0.0, 9.5, 4.0), 1.0, "EPSG:32608").bounds
        (0.0, 0.0, 10.0, 4.0)
        """
        xmin, ymin, xmax, ymax = checked(bounds, (4,), "the grid's bounds").tolist()
        if not (np.isfinite(step_m) and step_m > 0):
            raise InputError(f"the grid's step is {step_m} m; it must be greater than 0.")
        columns, rows = np.ceil((xmax - xmin) / step_m - 1e-9), np.ceil((ymax - ymin) / step_m - 1e-9)
        return cls((xmin, ymin, xmin + float(columns) * step_m, ymin + float(rows) * step_m), step_m, crs)

    def _summary(self) -> str:
        rows, columns = self.shape
        return f"{rows} × {columns} nodes every {self.step_m:g} m, {self.crs.name}"

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (north to south) and columns (west to east)."""
        xmin, ymin, xmax, ymax = self.bounds
        return round((ymax - ymin) / self.step_m) + 1, round((xmax - xmin) / self.step_m) + 1

    @cached_property
    def x(self) -> FloatArray:
        """Easting of the columns [m], (W,), ascending."""
        array: FloatArray = frozen(self.bounds[0] + self.step_m * np.arange(self.shape[1]))
        return array

    @cached_property
    def y(self) -> FloatArray:
        """Northing of the rows [m], (H,), descending."""
        array: FloatArray = frozen(self.bounds[3] - self.step_m * np.arange(self.shape[0]))
        return array

    @property
    def xy(self) -> FloatArray:
        """Easting and northing of every node [m], (H * W, 2), row by row."""
        return lattice_places(self.x, self.y)

    @property
    def transform(self) -> Affine:
        """Map (column, row) of a cell's corner to easting and northing."""
        half = 0.5 * self.step_m
        return Affine(self.step_m, 0.0, self.bounds[0] - half, 0.0, -self.step_m, self.bounds[3] + half)
