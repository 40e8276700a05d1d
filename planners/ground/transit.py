"""Transits: shortest paths through the free ground, around no-go zones and impassable ground."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from planners.ground.shortest_paths import Bends, Links, Network, links, sights, way
from planners.ground.walls import Walls, walls
from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError

MARGIN_M = 1e-3
"""Waypoints keep this distance from slanted borders, so that rounding puts none outside [m]."""

MAX_CORNERS = 20_000
"""More corners than this make the network of transits too large; the outline is to be simplified first."""


@dataclass(frozen=True, eq=False)
class FreeGround:
    """The ground that every metre of every leg must stay on, and the shortest ways within it.

    Parameters
    ----------
    polygon : shapely.Polygon or shapely.MultiPolygon
        The area less no-go zones and impassable ground [m].

    Notes
    -----
    Shortest ways bend at reflex corners only, which are moved `MARGIN_M` into the ground;
    they are therefore longer than the true shortest ones by about that much per bend.
    Passages narrower than two margins count as closed.

    Raises
    ------
    InputError
        Ground with more than `MAX_CORNERS` corners, or narrower than two margins everywhere.

    Examples
    --------
    >>> wall = shapely.box(40.0, 0.0, 60.0, 90.0)
    >>> ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0) - wall)
    >>> ground.way((10.0, 10.0), (90.0, 10.0)).round(1)
    array([[10., 10.],
           [40., 90.],
           [60., 90.],
           [90., 10.]])
    """

    polygon: Polygon | MultiPolygon

    def __post_init__(self) -> None:
        n_corners = int(shapely.get_num_coordinates(self.polygon))
        if n_corners > MAX_CORNERS:
            raise InputError(
                f"the ground has {n_corners} corners; at most {MAX_CORNERS} can be planned on, simplify the outline by a metre or so first."
            )
        if self.inner.is_empty:
            raise InputError(
                "the free ground is narrower than 2 mm everywhere; nothing can be driven, give a wider area."
            )
        shapely.prepare(self.polygon)
        shapely.prepare(self.inner)

    @cached_property
    def inner(self) -> Polygon | MultiPolygon:
        """The ground less a border of `MARGIN_M`."""
        return shapely.orient_polygons(self.polygon.buffer(-MARGIN_M, join_style="mitre"))

    @cached_property
    def parts(self) -> tuple[Polygon, ...]:
        """Pieces of ground that no way joins, the largest first."""
        pieces = sorted(shapely.get_parts(self.inner), key=lambda part: -part.area)
        return tuple(pieces)

    @cached_property
    def origin(self) -> FloatArray:
        """Where the network's local coordinates begin [m]."""
        xmin, ymin, _, _ = self.polygon.bounds
        corner: FloatArray = np.floor(np.array([xmin, ymin]))
        return corner

    @cached_property
    def walls(self) -> Walls:
        """The borders as edges."""
        rings = [
            shapely.get_coordinates(ring) - self.origin
            for ring in shapely.get_rings(shapely.get_parts(self.polygon))
        ]
        return walls(np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in rings]))

    @cached_property
    def bends(self) -> Bends:
        """The reflex corners, `MARGIN_M` inside the ground."""
        before, here, after = [], [], []
        for ring in shapely.get_rings(shapely.get_parts(self.inner)):
            xy = shapely.get_coordinates(ring)[:-1] - self.origin
            before.append(np.roll(xy, 1, axis=0))
            here.append(xy)
            after.append(np.roll(xy, -1, axis=0))
        a, b, c = np.vstack(before), np.vstack(here), np.vstack(after)
        u, v = b - a, c - b
        is_reflex = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
        return Bends(b[is_reflex], a[is_reflex], c[is_reflex])

    @cached_property
    def links(self) -> Links:
        """Which reflex corners see one another."""
        joined: Links = links(self.bends, self.walls)
        return joined

    def part_of(self, xy: Any) -> IntArray:
        """Return the index in `parts` of the piece nearest to each point (N, 2)."""
        points = shapely.points(np.asarray(xy, dtype=np.float64).reshape(-1, 2))
        tree = shapely.STRtree(self.parts)
        index: IntArray = np.asarray(tree.nearest(points), dtype=np.int64)
        return index

    def inside(self, xy: Any) -> FloatArray:
        """Return the points (N, 2), those on the border moved `MARGIN_M` or so into the ground."""
        points = np.array(xy, dtype=np.float64).reshape(-1, 2)
        for i in np.flatnonzero(~shapely.contains_xy(self.inner, points[:, 0], points[:, 1])):
            nearest = shapely.shortest_line(self.inner, Point(points[i]))
            points[i] = shapely.get_coordinates(nearest)[0]
        return points

    def network(self, xy: FloatArray) -> Network:
        """Return the network of ways between points (N, 2), which must be inside."""
        points = np.ascontiguousarray(xy - self.origin)
        return Network(sights(points, self.bends, self.walls), self.bends, self.links, self.walls)

    def covers(self, lines: Any) -> Any:
        """Return which lines have no metre outside the ground, exactly."""
        return shapely.covers(self.polygon, lines)

    def way(self, a: Any, b: Any) -> FloatArray:
        """Return the waypoints (K, 2) of the shortest way between two points of the ground [m].

        Raises
        ------
        InputError
            A point outside the ground, or two points that no way joins.
        """
        ends = np.array([a, b], dtype=np.float64)
        for end in ends:
            if not self.polygon.intersects(Point(end)):
                raise InputError(
                    f"the point ({end[0]:.1f}, {end[1]:.1f}) is not on free ground; move it there."
                )
        return self.between(ends, self.network(self.inside(ends)), 0, 1)

    def between(self, ends: FloatArray, network: Network, a: int, b: int) -> FloatArray:
        """Return the way from end `a` to end `b`, whose inside points were given to `network`."""
        straight = ends[[a, b]]
        if self.covers(LineString(straight)):
            return straight
        length, points = way(a, b, network)
        if not np.isfinite(length):
            raise InputError(
                f"no way leads from ({ends[a, 0]:.1f}, {ends[a, 1]:.1f}) to ({ends[b, 0]:.1f}, {ends[b, 1]:.1f}); "
                "the ground between them is closed, open it or survey the two parts separately."
            )
        return self._with_ends(ends[a], points + self.origin, ends[b])

    def _with_ends(self, first: FloatArray, points: FloatArray, last: FloatArray) -> FloatArray:
        """Lead the way to ends that lie on the border: straight where that is free, else by the inside point."""
        head = points[1:] if self.covers(LineString([first, points[1]])) else points
        points = np.vstack([first, head]) if len(head) != len(points) else np.vstack([first, points])
        tail = points[:-1] if self.covers(LineString([points[-2], last])) else points
        full = np.vstack([tail, last])
        keep = np.r_[True, np.hypot(*np.diff(full, axis=0).T) > 0.0]
        return full[keep]
