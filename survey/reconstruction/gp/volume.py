"""Volumes over a polygon and their change between two surveys, with standard deviations."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core.arrays import FloatArray
from survey.core.errors import InputError


@dataclass(frozen=True)
class Volume:
    """A volume and its standard deviation [m³], and the area it stands on [m²].

    Examples
    --------
    >>> later, earlier = Volume(90.0, 3.0, 10.0), Volume(100.0, 4.0, 10.0)
    >>> later.minus(earlier)
    Volume(mean_m3=-10.0, std_m3=5.0, area_m2=10.0)
    """

    mean_m3: float
    std_m3: float
    area_m2: float

    def minus(self, earlier: "Volume") -> "Volume":
        """Return the change since an earlier survey of the same ground, whose errors are independent.

        Raises
        ------
        InputError
            When the two stand on different areas.

        Notes
        -----
        Errors that both share, a common satellite prior's where neither survey went,
        cancel in reality; here they are counted twice, which is on the safe side.
        """
        if abs(self.area_m2 - earlier.area_m2) > 1e-6 * self.area_m2:
            raise InputError(
                f"the volumes stand on {self.area_m2:.1f} and {earlier.area_m2:.1f} m²; take the same polygon for both."
            )
        std = float(np.hypot(self.std_m3, earlier.std_m3))
        return Volume(self.mean_m3 - earlier.mean_m3, std, self.area_m2)


def quadrature(polygon: Polygon | MultiPolygon, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Return nodes (M, 2) inside a polygon and the area each stands for (M,) [m²]; the areas add up to the polygon's.

    Raises
    ------
    InputError
        An empty or crossing polygon, or one narrower than the step everywhere.
    """
    if polygon.is_empty or not polygon.is_valid or polygon.area <= 0.0:
        raise InputError("the polygon is empty or crosses itself; give a simple one.")
    xmin, ymin, xmax, ymax = polygon.bounds
    # Cell centres, so that a rectangle of whole steps is integrated by the midpoint rule.
    x, y = (
        low
        + (np.arange(max(round((high - low) / step_m), 1)) + 0.5)
        * (high - low)
        / max(round((high - low) / step_m), 1)
        for low, high in ((xmin, xmax), (ymin, ymax))
    )
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = shapely.contains_xy(polygon, nodes[:, 0], nodes[:, 1])
    if not inside.any():
        raise InputError(f"no node lies in the polygon at steps of {step_m:g} m; take a smaller step.")
    return nodes[inside], np.full(int(inside.sum()), polygon.area / inside.sum())
