import numpy as np
import pytest
import shapely

from planners.routes.shortest_paths import FreeGround
from planners.swaths.heading import across_marked_grain, heading_by
from planners.swaths.reference_lines import axes_of, stretch_lengths
from survey import Dem, Grid, InputError

CRS = "EPSG:32608"
GROUND = FreeGround(shapely.box(0.0, 0.0, 300.0, 100.0))
GRID = Grid((0.0, 0.0, 300.0, 100.0), 10.0, CRS)


def dem(heights) -> Dem:
    return Dem.on(GRID, np.broadcast_to(heights, GRID.shape))


def test_slope_runs_along_the_mean_gradient():
    east, north = np.meshgrid(GRID.x, GRID.y)
    assert heading_by("slope", GROUND, dem=dem(0.1 * east + 0.1 * north[::-1][::-1])) == pytest.approx(45.0)


def test_grain_runs_across_ridges():
    assert heading_by("grain", GROUND, dem=dem(np.sin(GRID.x / 20.0))) == pytest.approx(0.0, abs=1e-6)
    assert heading_by("grain", GROUND, dem=dem(np.sin(GRID.y / 20.0)[:, None])) == pytest.approx(90.0)


def test_fewest_swaths_of_a_wide_field_run_along_its_longer_side():
    assert heading_by("fewest-swaths", GROUND, spacing_m=25.0) == 0.0


@pytest.mark.parametrize(
    ("rule", "given", "message"),
    [
        ("fewest-swaths", {}, "needs the spacing"),
        ("slope", {}, "needs a DEM"),
        ("grain", {}, "needs a DEM"),
        ("slope", {"dem": dem(1.0)}, "does not slope on average"),
        ("grain", {"dem": dem(0.1 * GRID.x)}, "alike in all directions"),
    ],
)
def test_rules_refuse_what_they_cannot_decide(rule, given, message):
    with pytest.raises(InputError, match=message):
        heading_by(rule, GROUND, **given)


def test_a_dem_elsewhere_is_refused():
    far = FreeGround(shapely.box(1000.0, 0.0, 1300.0, 100.0))
    with pytest.raises(InputError, match="no height on the ground"):
        heading_by("slope", far, dem=dem(0.1 * GRID.x))


def test_only_a_marked_grain_turns_the_swaths():
    ridges_along = dem(5.0 * np.sin(GRID.y / 15.0)[:, None])
    assert across_marked_grain(GROUND.polygon, ridges_along) == 90.0
    assert across_marked_grain(GROUND.polygon, dem(5.0 * np.sin(GRID.x / 15.0))) == 0.0


def test_stretches_of_lines_are_those_that_cutting_gives():
    rng = np.random.default_rng(3)
    for _ in range(40):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 30))
        star = np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(100.0, 500.0, (30, 1))
        ground = shapely.Polygon(star) - shapely.box(-30.0, -20.0, 30.0, 20.0)
        heading_deg = float(rng.choice([0.0, 90.0, rng.uniform(0.0, 180.0)]))
        along, left = axes_of(heading_deg)
        offsets = rng.uniform(-400.0, 400.0, 5)
        for offset, lengths in zip(offsets, stretch_lengths(ground, heading_deg, offsets), strict=True):
            line = shapely.LineString(np.outer([-999.0, 999.0], along) + offset * left)
            cut = np.sort(shapely.length(shapely.get_parts(ground & line)))
            np.testing.assert_allclose(np.sort(lengths), cut[cut > 0.0], atol=1e-6)
