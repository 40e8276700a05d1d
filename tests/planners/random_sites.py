"""Random sites for the tests: concave outlines with holes, thin necks, islands."""

import numpy as np
import shapely
from shapely import Polygon


def star(rng: np.random.Generator, centre: tuple[float, float], radius_m: float, n_corners: int) -> Polygon:
    """Return a star-shaped polygon whose corners lie between 0.35 and 1 of the radius."""
    angle = (np.arange(n_corners) + rng.uniform(0.1, 0.9, n_corners)) * 2.0 * np.pi / n_corners
    reach = radius_m * rng.uniform(0.35, 1.0, n_corners)
    return Polygon(np.column_stack([centre[0] + reach * np.cos(angle), centre[1] + reach * np.sin(angle)]))


def random_site(seed: int, size_m: float = 120.0) -> shapely.Geometry:
    """Return ground of one or more parts: a concave outline, sometimes an island, joined by a thin neck or not."""
    rng = np.random.default_rng(seed)
    outline = star(rng, (0.0, 0.0), size_m, int(rng.integers(4, 12)))
    if rng.random() < 0.4:
        away = (1.6 * size_m, float(rng.uniform(-40.0, 40.0)))
        island = star(rng, away, 0.4 * size_m, 6)
        outline = shapely.union(outline, island)
        if rng.random() < 0.7:
            neck = shapely.LineString([(0.0, 0.0), away]).buffer(float(rng.uniform(0.3, 4.0)))
            outline = shapely.union(outline, neck)
    holes = [
        star(
            rng,
            tuple(rng.uniform(-0.7, 0.7, 2) * size_m),
            float(rng.uniform(3.0, 30.0)),
            int(rng.integers(3, 8)),
        )
        for _ in range(int(rng.integers(0, 6)))
    ]
    ground = shapely.difference(outline, shapely.union_all(holes)) if holes else outline
    parts = [part for part in shapely.get_parts(ground) if part.geom_type == "Polygon" and part.area > 1.0]
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def largest_part(ground: shapely.Geometry) -> Polygon:
    return max(shapely.get_parts(ground), key=lambda part: part.area)
