"""Shortest paths on free ground: `FreeGround` holds a polygon with its network and returns the shortest ways on it.

The network is a visibility graph over reflex corners (see `planners.routes.visibility`, whose compiled loops are loaded
when a way is first asked for: most routes on open ground need none).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from survey.core import FloatArray, InputError, IntArray
from survey.data.outlines import MOST_CORNERS

if TYPE_CHECKING:
    from planners.routes.visibility import Bends, Links, Network, Walls


def _rings(ground: Polygon | MultiPolygon) -> list[int]:
    """Return the number of rings of each part."""
    return [1 + int(shapely.get_num_interior_rings(part)) for part in shapely.get_parts(ground)]


def ends_of(swaths: Sequence[FloatArray]) -> FloatArray:
    """Return the first and last points (2 N, 2) of the swaths, swath by swath."""
    return np.array([[swath[0], swath[-1]] for swath in swaths], dtype=np.float64).reshape(-1, 2)


MARGIN_M = 1e-3
"""Waypoints keep this distance from slanted borders, so that rounding puts none outside [m]."""
MANY_CORNERS, _SIMPLER_M = 2000, 0.1
"""Corners of the ground above which ways are searched on a simpler outline, and how much may be cut off there [m]."""


@dataclass(frozen=True, eq=False)
class FreeGround:
    """The ground that every metre of every leg must stay on, and the shortest ways within it.

    `polygon`: the area less no-go zones and impassable ground [m].

    Shortest ways bend at reflex corners only, which are moved `MARGIN_M` into the ground;
    they are therefore longer than the true shortest ones by about that much per bend.
    Passages narrower than two margins count as closed. On ground of more than `MANY_CORNERS` they bend at the corners of
    `outline`, less than 0.2 m from the border.

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
        if n_corners > MOST_CORNERS:
            raise InputError(
                f"the ground has {n_corners} corners; at most {MOST_CORNERS} can be planned on, simplify the outline by a metre or so first."
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
    def outline(self) -> "FreeGround":
        """Ground of fewer corners within this one, on which ways are searched; itself where it has few.

        It is the ground less a border, simplified by no more than that, and lies within the ground: this is tested, as is
        that no part and no hole is lost.
        """
        if shapely.get_num_coordinates(self.polygon) <= MANY_CORNERS:
            return self
        shrunk = self.polygon.buffer(-_SIMPLER_M, join_style="mitre")
        simpler = shapely.simplify(shrunk, 0.9 * _SIMPLER_M, preserve_topology=False)
        is_within = simpler.is_valid and _rings(simpler) == _rings(self.polygon) and self.covers(simpler)
        return FreeGround(simpler) if is_within else self

    @cached_property
    def origin(self) -> FloatArray:
        """Where the network's local coordinates begin [m]."""
        xmin, ymin, _, _ = self.polygon.bounds
        corner: FloatArray = np.floor(np.array([xmin, ymin]))
        return corner

    @cached_property
    def walls(self) -> "Walls":
        """The borders as edges."""
        from planners.routes.visibility import walls

        rings = [
            shapely.get_coordinates(ring) - self.origin
            for ring in shapely.get_rings(shapely.get_parts(self.polygon))
        ]
        return walls(np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in rings]))

    @cached_property
    def bends(self) -> "Bends":
        """The reflex corners, `MARGIN_M` inside the ground."""
        from planners.routes.visibility import Bends

        before, here, after = [], [], []
        for ring in shapely.get_rings(shapely.get_parts(self.inner)):
            xy = shapely.get_coordinates(ring)[:-1] - self.origin
            before.append(np.roll(xy, 1, axis=0))
            here.append(xy)
            after.append(np.roll(xy, -1, axis=0))
        a, b, c = np.vstack(before), np.vstack(here), np.vstack(after)
        u, v = b - a, c - b
        is_reflex = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
        xy, to_before, to_after = b[is_reflex], -u[is_reflex], v[is_reflex]
        slack = 1e-4 * np.column_stack([np.hypot(*side.T) for side in (to_before, to_after)])
        return Bends(xy, to_before, to_after, slack)

    @cached_property
    def links(self) -> "Links":
        """Which reflex corners see one another."""
        from planners.routes.visibility import links

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

    def network(self, xy: FloatArray) -> "Network":
        """Return the network of ways between points (N, 2), which must be inside."""
        return self._network(xy) if self.outline is self else self.outline._network(self.outline.inside(xy))

    def _network(self, xy: FloatArray) -> "Network":
        from planners.routes.visibility import Network, sights

        points = np.ascontiguousarray(xy - self.origin)
        return Network(sights(points, self.bends, self.walls), self.bends, self.links, self.walls)

    def covers(self, lines: Any) -> Any:
        """Return which lines have no metre outside the ground, exactly."""
        return shapely.covers(self.polygon, lines)

    def way(self, a: Any, b: Any) -> FloatArray:
        """Return the waypoints (K, 2) of the shortest way between two points of the ground [m]."""
        ends = np.array([a, b], dtype=np.float64)
        for end in ends:
            if not self.polygon.intersects(Point(end)):
                raise InputError(
                    f"the point ({end[0]:.1f}, {end[1]:.1f}) is not on free ground; move it there."
                )
        return self.between(ends, self.network(self.inside(ends)), 0, 1)

    def between(self, ends: FloatArray, network: "Network", a: int, b: int) -> FloatArray:
        """Return the way from end `a` to end `b`, whose inside points were given to `network`."""
        straight = ends[[a, b]]
        if self.covers(LineString(straight)):
            return straight
        from planners.routes.visibility import way

        length, points = way(a, b, network)
        if self.outline is not self:
            if np.isfinite(length):
                found = self._with_ends(ends[a], points + self.outline.origin, ends[b])
                if self.covers(LineString(found)):
                    return found
            length, points = way(0, 1, self._network(self.inside(straight)))
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


@lru_cache(maxsize=8)
def shared_ground(polygon: Polygon | MultiPolygon) -> FreeGround:
    """Return the ground of a polygon; the steps of a plan, and plans of one area, share it with its network."""
    return FreeGround(polygon)
