"""Whether one place sees another past the edges of the ground."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

from planners.routes.visibility import sees, walls


def edges_of(polygon: shapely.Polygon) -> np.ndarray:
    """Return the edges (M, 4) of a polygon and its holes."""
    rings = [polygon.exterior, *polygon.interiors]
    points = [np.asarray(ring.coords) for ring in rings]
    return np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in points])


GROUND = (
    shapely.box(0.0, 0.0, 100.0, 60.0)
    - shapely.box(30.0, 10.0, 45.0, 50.0)
    - shapely.box(60.0, 20.0, 80.0, 30.0)
)


@pytest.mark.parametrize(
    ("p", "q", "is_seen"),
    [
        ((10.0, 30.0), (20.0, 40.0), True),
        ((10.0, 30.0), (50.0, 30.0), False),
        ((50.0, 30.0), (10.0, 30.0), False),
        ((10.0, 5.0), (90.0, 5.0), True),
        ((50.0, 55.0), (50.0, 5.0), True),
        ((70.0, 55.0), (70.0, 5.0), False),
    ],
)  # fmt: skip
def test_a_hole_hides_what_is_behind_it(
    p: tuple[float, float], q: tuple[float, float], is_seen: bool
) -> None:
    assert sees(p, q, walls(edges_of(GROUND))) is is_seen


def test_sight_agrees_with_the_segments_that_the_ground_covers(rng: np.random.Generator) -> None:
    index = walls(edges_of(GROUND))
    inner = GROUND.buffer(-0.5)
    places = [p for p in rng.uniform((0.0, 0.0), (100.0, 60.0), (60, 2)) if inner.covers(shapely.Point(p))]
    for p, q in pairwise(places):
        assert sees(tuple(p), tuple(q), index) == GROUND.covers(shapely.LineString([p, q]))
