"""Local scale factors of a map projection.

Coordinates, steps and geometry stay in the metres of the survey's CRS (grid metres). What is reported as a
length, area or volume counts on the ground: lengths are divided by the linear scale factor, areas by the areal
one. The ground is the ellipsoid of the CRS's datum; the height above it changes a length by 0.016 % per
kilometre and is left out. `survey.core.map_scale.ground` has the lengths and areas.
"""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from survey.core.arrays import Bounds, FloatArray, lattice_places
from survey.core.crs.checks import projected_crs
from survey.core.map_scale.derivatives import ground_jacobian

NOTABLE = 0.01
"""A linear scale factor farther than this from 1 is warned of."""
_N_SUMMARY = 9


class ScaleFactors(NamedTuple):
    """Scale factors at N places: grid metres for each metre on the ground.

    Parameters
    ----------
    meridional, parallel : (N,) ndarray
        Along the meridian and along the parallel.
    areal : (N,) ndarray
        Grid area over ground area.
    least, largest : (N,) ndarray
        Over all directions: the half axes of Tissot's ellipse. Equal for a conformal projection.
    """

    meridional: FloatArray
    parallel: FloatArray
    areal: FloatArray
    least: FloatArray
    largest: FloatArray

    @property
    def linear(self) -> FloatArray:
        """Square root of the areal factor: the linear factor of a conformal projection, a mean of any other, (N,)."""
        return np.sqrt(self.areal)


def scale_factors(crs: Any, xy: Any) -> ScaleFactors:
    """Return the projection's local scale factors at places.

    The inverse projection is differentiated numerically and measured on the ellipsoid of the datum. For
    EPSG:3857 this differs from `pyproj.Proj.get_factors`, which measures on the sphere that the projection's
    formula uses, by up to 0.7 % in the areal factor.

    Parameters
    ----------
    crs : str or pyproj.CRS
        Projected, in metres; compound and bound systems give their horizontal part.
    xy : (N, 2) array_like
        Easting and northing [m], in this order whatever the axis order of the CRS.

    Returns
    -------
    ScaleFactors
        Arrays of N; all 1 for a local (engineering) CRS, which no transformation ties to the Earth.

    Raises
    ------
    InputError
        A CRS in degrees or feet, or places that the projection cannot show.

    Examples
    --------
    >>> scale_factors("EPSG:32608", [[500_000.0, 6_700_000.0]]).meridional.round(4)
    array([0.9996])
    """
    jacobian = ground_jacobian(crs, xy)
    grid_per_ground = np.linalg.inv(jacobian)
    half_axes = np.asarray(np.linalg.svd(grid_per_ground, compute_uv=False), dtype=np.float64)
    east, north = np.linalg.norm(grid_per_ground, axis=1).T
    largest, least = half_axes.T
    return ScaleFactors(north, east, largest * least, least, largest)


@dataclass(frozen=True)
class ScaleRange:
    """Least, mean and largest value of a scale factor over some ground.

    Parameters
    ----------
    min, mean, max : float
        Least, mean and largest factor.
    """

    min: float
    mean: float
    max: float

    @classmethod
    def of(cls, least: FloatArray, middle: FloatArray, largest: FloatArray) -> Self:
        """Summarise factors at places (N,).

        Parameters
        ----------
        least, middle, largest : (N,) array_like
            Factors at places: the least over all directions, the mean and the largest.

        Returns
        -------
        ScaleRange
            Their least, mean and largest value.
        """
        return cls(float(least.min()), float(middle.mean()), float(largest.max()))


@dataclass(frozen=True)
class MapScale:
    """Scale factors of a projection over a survey: grid metres for each metre on the ground.

    Parameters
    ----------
    crs_name : str
        Name of the CRS.
    linear, areal : ScaleRange
        Of lengths and of areas. Where the projection is not conformal, the ends of `linear` are those over all
        directions.

    Examples
    --------
    >>> scale = MapScale.over("EPSG:32608", (499_000.0, 6_700_000.0, 501_000.0, 6_701_000.0))
    >>> round(scale.linear.mean, 4), round(scale.areal.mean, 4), scale.warning
    (0.9996, 0.9992, '')
    """

    crs_name: str
    linear: ScaleRange
    areal: ScaleRange

    @classmethod
    def at(cls, crs: Any, xy: Any) -> Self:
        """Summarise the scale factors at places.

        Parameters
        ----------
        crs : str or pyproj.CRS
            Projected, in metres.
        xy : (N, 2) array_like
            Easting and northing [m], N of at least 1.

        Returns
        -------
        MapScale
            With equal weight for every place.

        Raises
        ------
        InputError
            As `scale_factors` does.
        """
        found = scale_factors(crs, xy)
        name = projected_crs(crs, "the map").name
        linear = ScaleRange.of(found.least, found.linear, found.largest)
        return cls(name, linear, ScaleRange.of(*(found.areal,) * 3))

    @classmethod
    def over(cls, crs: Any, bounds: Bounds) -> Self:
        """Summarise the scale factors over a rectangle.

        Parameters
        ----------
        crs : str or pyproj.CRS
            Projected, in metres.
        bounds : (4,) sequence of float
            ``(xmin, ymin, xmax, ymax)`` [m].

        Returns
        -------
        MapScale
            From 9 × 9 nodes, the corners included.

        Raises
        ------
        InputError
            As `scale_factors` does.
        """
        xmin, ymin, xmax, ymax = bounds
        x, y = np.linspace(xmin, xmax, _N_SUMMARY), np.linspace(ymin, ymax, _N_SUMMARY)
        return cls.at(crs, lattice_places(x, y))

    @property
    def notable_factor(self) -> float:
        """Mean linear factor; 1 where it is within 1 % of 1, as in UTM zones and most national grids."""
        return 1.0 if abs(self.linear.mean - 1.0) <= NOTABLE else self.linear.mean

    @property
    def warning(self) -> str:
        """One sentence where a length differs by more than 1 % from that on the ground, else ``""``."""
        farthest = max((self.linear.min, self.linear.max), key=lambda k: abs(k - 1.0))
        if abs(farthest - 1.0) <= NOTABLE:
            return ""
        return (
            f"lengths in {self.crs_name} are {farthest:.3f} times those on the ground; lengths, areas and volumes "
            "are given on the ground, while steps and coordinates stay in the CRS (a UTM zone differs by less than 0.1 %)"
        )

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Return the factors as plain values for JSON.

        Returns
        -------
        dict
            ``linear`` and ``areal``, each with ``min``, ``mean`` and ``max``.

        Examples
        --------
        >>> sorted(MapScale.at("EPSG:3413", [[0.0, -2e6]]).to_dict())
        ['areal', 'linear']
        """
        return {"linear": asdict(self.linear), "areal": asdict(self.areal)}
