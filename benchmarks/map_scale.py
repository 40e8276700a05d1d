"""Measure one scene in four map projections: ``python -m benchmarks.map_scale``.

A lake sinks as a paraboloid, and a route of 10 km leads around it. Volume and area of the change and the length of
the route are those of the ground, so they have to agree within 0.3 % between every two projections. The result goes
to ``results/benchmarks/map_scale.json``.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np
import shapely
from pyproj import CRS, Geod, Transformer

from benchmarks.writer import TABLES, Run
from survey import Dem, Grid, Leg, Route
from survey.core.arrays import FloatArray
from survey.core.map_scale import scale_factors
from survey.scoring import Change, change

RESULT = TABLES / "map_scale.json"
PROJECTIONS = ("EPSG:32610", "EPSG:3857", "EPSG:3413", "EPSG:3031")
CENTRE = (-123.3, 61.0)
BAR = 0.003
EARTH = Geod(ellps="WGS84")
RADIUS_M, DEEPEST_M = 1500.0, -8.0
# A paraboloid: half the depth over the disc.
VOLUME_M3 = 0.5 * DEEPEST_M * np.pi * RADIUS_M**2


class Measures(NamedTuple):
    """Volume and area of the change, and length of the route, on the ground."""

    volume_m3: float
    area_m2: float
    length_m: float


def sunken_lake(crs: str, centre: tuple[float, float]) -> Change:
    """Return the change of a lake that sank as a paraboloid, mapped with cells of about 16 m on the ground."""
    to_crs = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    east, north = to_crs.transform(*centre)
    factor = float(scale_factors(crs, [[east, north]]).linear[0])
    step, half = 16.0 * factor, 2400.0 * factor
    grid = Grid.over((east - half, north - half, east + half, north + half), step, crs)
    lon, lat = to_crs.transform(grid.xy[:, 0], grid.xy[:, 1], direction="INVERSE")
    distance = EARTH.inv(np.full(len(lon), centre[0]), np.full(len(lon), centre[1]), lon, lat)[2]
    sunk = (DEEPEST_M * np.clip(1.0 - (distance / RADIUS_M) ** 2, 0.0, None)).reshape(grid.shape)
    noise = np.random.default_rng(4).normal(0.0, 0.01, grid.shape)
    outline = shapely.Polygon(_around(to_crs, centre, RADIUS_M))
    return change(Dem.on(grid, sunk + noise), Dem.on(grid, np.zeros(grid.shape)), {"lake": outline})


def route_around(crs: str, centre: tuple[float, float]) -> Route:
    """Return a route around the lake, 50 m from its shore."""
    to_crs = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    return Route((Leg("transit", _around(to_crs, centre, RADIUS_M + 50.0)),), CRS(crs), "around the lake")


def _around(to_crs: Transformer, centre: tuple[float, float], radius_m: float) -> FloatArray:
    """Return places (720, 2) on a circle of the ground."""
    bearing = np.linspace(0.0, 360.0, 721)[:-1]
    lon, lat, _ = EARTH.fwd(*(np.full(720, value) for value in centre), bearing, np.full(720, radius_m))
    return np.column_stack(to_crs.transform(lon, lat))


def measured(crs: str) -> Measures:
    """Return the measures of the scene in a projection."""
    volume = sunken_lake(crs, CENTRE).volumes[0]
    length_m = route_around(crs, CENTRE).ground_length_m
    return Measures(volume.volume_m3, volume.area_m2, length_m)


def largest_differences(found: dict[str, Measures]) -> dict[str, dict[str, float]]:
    """Return the relative difference of every measure between every two projections."""
    return {
        f"{one} and {other}": {
            name: round(abs(a - b) / abs(b), 6)
            for name, a, b in zip(Measures._fields, found[one], found[other], strict=True)
        }
        for one, other in combinations(found, 2)
    }


def main() -> None:
    """Measure the scene in every projection and store the table."""
    run = Run.begin(main, RESULT)
    found = {crs: measured(crs) for crs in PROJECTIONS}
    differences = largest_differences(found)
    content = {
        "command": "python -m benchmarks.map_scale",
        "bar": BAR,
        "largest": max(value for pair in differences.values() for value in pair.values()),
        "measures": {crs: measures._asdict() for crs, measures in found.items()},
        "differences": differences,
    }
    run.write(content)
    print(RESULT.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
