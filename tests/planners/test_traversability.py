"""Ground that a rover can drive on, from slopes and roughness that are known."""

import numpy as np
import pytest
import shapely
from affine import Affine
from scipy.ndimage import gaussian_filter
from scipy.spatial.distance import cdist

from planners.routes.rover import RoverLimits
from planners.routes.traversability import between_heights, drivable, on_free_ground, roughness, slope_scale
from survey import Leg, Route
from survey.core import validated
from survey.core.errors import ConfigError, InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem

CRS = "EPSG:32608"
TRANSFORM = Affine(1.0, 0.0, -10.5, 0.0, -1.0, 110.5)


def dem_of(height: np.ndarray) -> Dem:
    return Dem(height, TRANSFORM, CRS)


def nodes() -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(np.arange(-10.0, 111.0), np.arange(110.0, -11.0, -1.0))


@pytest.fixture
def area() -> SurveyArea:
    return SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), CRS)


def test_flat_ground_is_all_drivable(area: SurveyArea) -> None:
    site = drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem_of(np.zeros((121, 121))))
    assert site.ground.polygon.equals(area.polygon)
    assert site.left_out == ()


def test_every_metre_of_the_ground_is_within_the_limits(area: SurveyArea) -> None:
    x, y = nodes()
    dem = dem_of(8.0 * np.exp(-((x - 50.0) ** 2 + (y - 50.0) ** 2) / 200.0))
    site = drivable(area, RoverLimits(max_pitch_deg=30.0, max_roll_deg=15.0), dem)
    steep = dem.slope().elevation > 15.0
    xy = dem.xy[steep.ravel()]
    shapely.prepare(site.ground.polygon)
    # No steep cell, its corners included, touches the ground, and no slope in between is too steep.
    places = np.random.default_rng(1).uniform(0.0, 100.0, (4000, 2))
    on_ground = shapely.contains_xy(site.ground.polygon, places[:, 0], places[:, 1])
    assert dem.slope().at(places[on_ground]).max() <= 15.0
    for dx, dy in ((0.0, 0.0), (0.499, 0.499), (-0.499, 0.499), (0.499, -0.499), (-0.499, -0.499)):
        assert not shapely.contains_xy(site.ground.polygon, xy[:, 0] + dx, xy[:, 1] + dy).any()
    assert {piece.reason for piece in site.left_out} >= {"too steep"}
    # Little more than the steep ring is given up: its cells, a cell's width around, and the top it cuts off.
    assert site.ground.polygon.area > area.polygon.area - 1.8 * np.pi * 25.0**2


def test_a_cliff_that_cuts_the_site_names_the_part_behind_it(area: SurveyArea) -> None:
    x, _ = nodes()
    dem = dem_of(np.where(x > 70.0, 20.0, 0.0))
    site = drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem)
    cut_off = [piece for piece in site.left_out if piece.reason == "cut off"]
    assert len(cut_off) == 1
    assert cut_off[0].polygon.centroid.x > 75.0
    with pytest.raises(InputError, match=r"not all of the area can be reached .* \(cut off\)"):
        drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem, reach_all=True)


def test_the_part_with_the_start_is_planned() -> None:
    x, _ = nodes()
    dem = dem_of(np.where(x > 70.0, 20.0, 0.0))
    area = SurveyArea(shapely.box(0.0, 0.0, 100.0, 100.0), CRS, (), [[95.0, 50.0]])
    assert (
        drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem).ground.polygon.bounds[0]
        > 70.0
    )


def test_a_start_on_steep_ground_is_refused_with_the_reason() -> None:
    x, _ = nodes()
    dem = dem_of(np.where(x > 70.0, 20.0, 0.0))
    area = SurveyArea(shapely.box(0.0, 0.0, 100.0, 100.0), CRS, (), [[70.5, 50.0]])
    with pytest.raises(InputError, match=r"start \(70.5, 50.0\).*too steep"):
        drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem)


def test_ground_of_unknown_height_is_left_out(area: SurveyArea) -> None:
    height = np.zeros((121, 121))
    height[50:60, 50:60] = np.nan
    site = drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem_of(height))
    assert [piece.reason for piece in site.left_out] == ["height unknown"]
    small = Dem(np.zeros((50, 121)), TRANSFORM, CRS)
    assert (
        drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), small).left_out[0].reason
        == "height unknown"
    )


def test_rough_ground_is_left_out(area: SurveyArea) -> None:
    rng = np.random.default_rng(3)
    height = np.zeros((121, 121))
    height[60:, :] += rng.normal(0.0, 0.05, (61, 121))
    limits = RoverLimits(max_pitch_deg=60.0, max_roll_deg=60.0, max_roughness_m=0.02)
    site = drivable(area, limits, dem_of(height))
    assert site.left_out[0].reason == "too rough"
    assert site.ground.polygon.bounds[1] > 45.0


def test_roughness_is_that_of_white_noise_about_any_plane() -> None:
    rng = np.random.default_rng(5)
    x, y = nodes()
    values = roughness(dem_of(0.3 * x - 0.2 * y + rng.normal(0.0, 0.1, x.shape)))
    # 12 000 windows of 6 degrees of freedom each, nine of them dependent: about 1 % standard error.
    assert np.sqrt(np.nanmean(values**2)) == pytest.approx(0.1, rel=0.04)


def test_clearance_keeps_off_borders_and_closes_narrow_necks() -> None:
    outline = shapely.box(0, 0, 40, 40) | shapely.box(40, 18, 60, 22) | shapely.box(60, 0, 100, 40)
    area = SurveyArea(outline, CRS)
    wide = drivable(area, RoverLimits(clearance_m=1.0))
    assert len(wide.ground.parts) == 1
    narrow = drivable(area, RoverLimits(clearance_m=3.0))
    assert {piece.reason for piece in narrow.left_out} == {"too narrow", "cut off"}
    assert narrow.ground.polygon.distance(outline.exterior) >= 3.0 - 1e-6


def test_nothing_left_is_refused_with_reasons(area: SurveyArea) -> None:
    x, _ = nodes()
    with pytest.raises(InputError, match=r"no ground is left to drive on: .*too steep"):
        drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem_of(x))
    with pytest.raises(ValueError, match="max_pitch_deg"):
        RoverLimits(max_pitch_deg=0.0)


def test_the_ground_between_two_heights_is_the_tongue(
    area: SurveyArea, caplog: pytest.LogCaptureFixture
) -> None:
    _, y = nodes()
    dem = dem_of(y)  # one metre of height for each metre to the north
    tongue = between_heights(area, dem, below_m=40.0)
    # The first cell outside, at 41 m, is left out with half a cell around it.
    assert tongue.bounds == pytest.approx((0.0, 0.0, 100.0, 40.0), abs=0.6)
    assert "lies below 40 m; the rest is left out" in caplog.text
    band = between_heights(area, dem, above_m=20.0, below_m=40.0)
    assert band.bounds == pytest.approx((0.0, 20.0, 100.0, 40.0), abs=0.6)
    with pytest.raises(InputError, match=r"lies above 200 m of the prior \(its heights are -10 to 110 m\)"):
        between_heights(area, dem, above_m=200.0)
    void = dem_of(np.where(y < 30.0, np.nan, y))
    assert between_heights(area, void, below_m=60.0).bounds == pytest.approx(
        (0.0, 30.0, 100.0, 60.0), abs=0.6
    )


@pytest.mark.parametrize("line", [[[10.0, 10.0], [110.0, 10.0]], [[10.0, 50.0], [90.0, 50.0]]])
def test_a_route_that_leaves_the_free_ground_is_refused(line: list[list[float]]) -> None:
    area = SurveyArea(shapely.box(0.0, 0.0, 100.0, 100.0), CRS, no_go=(shapely.box(40.0, 40.0, 60.0, 60.0),))
    with pytest.raises(
        InputError, match=r"outside the area or in a no-go zone for (10|9\.99|20|19\.98)[.0-9]* m, first at"
    ):
        on_free_ground(Route((Leg("swath", line),), area.crs, "line"), area.free)
    near = Route((Leg("swath", [[10.0, -0.001], [90.0, -0.001]]),), area.crs, "line")
    assert on_free_ground(near, area.free) is near


TONGUE = SurveyArea.rectangle((300.0, 300.0, 3300.0, 3300.0), CRS)


def tongue(limit_deg: float, product: str | None, *, correlated_m: float = 0.0, wall_deg: float = 0.0):
    """Return what is drivable of a plane of 3° with errors of 4 m in cells of 30 m, and a wall of 300 m width across it."""
    rng = np.random.default_rng(11)
    x, y = np.meshgrid(np.arange(15.0, 3600.0, 30.0), np.arange(3585.0, 0.0, -30.0))
    height = np.tan(np.radians(3.0)) * y + np.tan(np.radians(wall_deg)) * np.clip(x - 1650.0, 0.0, 300.0)
    smooth = gaussian_filter(rng.standard_normal(x.shape), 6.0, mode="wrap")
    height += 4.0 * rng.standard_normal(x.shape) + correlated_m * smooth / smooth.std()
    dem = Dem(height, Affine(30.0, 0.0, 0.0, 0.0, -30.0, 3600.0), CRS)
    return drivable(
        TONGUE, RoverLimits(max_pitch_deg=limit_deg, max_roll_deg=limit_deg, slope_product=product), dem
    )


def too_steep(site) -> shapely.Geometry:
    return shapely.union_all([piece.polygon for piece in site.left_out if piece.reason == "too steep"])


@pytest.mark.parametrize(("limit_deg", "correlated_m"), [(20.0, 0.0), (20.0, 6.0), (10.0, 0.0), (10.0, 6.0)])
def test_a_flat_tongue_in_a_noisy_product_is_not_too_steep(limit_deg, correlated_m) -> None:
    site = tongue(limit_deg, "aster-30", correlated_m=correlated_m)
    assert too_steep(site).area <= 0.002 * TONGUE.polygon.area
    if limit_deg == 10.0:
        assert too_steep(tongue(limit_deg, None, correlated_m=correlated_m)).area > 0.2 * TONGUE.polygon.area


@pytest.mark.parametrize("limit_deg", [10.0, 20.0])
def test_a_wall_in_a_noisy_product_is_still_left_out(limit_deg) -> None:
    wall = shapely.box(1665.0, 300.0, 1935.0, 3300.0)
    closed = too_steep(tongue(limit_deg, "aster-30", correlated_m=6.0, wall_deg=30.0))
    assert shapely.intersection(closed, wall).area > 0.97 * wall.area
    assert shapely.difference(closed, wall.buffer(150.0)).area <= 0.002 * TONGUE.polygon.area


def test_planes_keep_their_slope_beside_gaps_at_any_scale() -> None:
    x, y = np.meshgrid(np.arange(60.0), np.arange(60.0))
    dem = Dem(
        np.where(x * y > 2000.0, np.nan, 6.0 * x - 2.0 * y), Affine(30.0, 0.0, 0.0, 0.0, -30.0, 0.0), CRS
    )
    slope = slope_scale(dem.step_m, RoverLimits(max_pitch_deg=5.0, slope_product="aster-30")).slope_deg(dem)
    assert slope[np.isfinite(dem.elevation)] == pytest.approx(
        np.degrees(np.arctan(np.hypot(6.0, 2.0) / 30.0))
    )


def test_the_scale_grows_with_the_errors_and_the_tilt_is_that_of_drawn_errors(rng) -> None:
    scales = [
        slope_scale(30.0, RoverLimits(max_pitch_deg=10.0, slope_product=name))
        for name in ("arcticdem-2", "copernicus-30", "aster-30")
    ]
    assert [one.n_cells for one in scales] == sorted(one.n_cells for one in scales)
    assert scales[0].n_cells == 0.0
    xy = 30.0 * np.stack(np.meshgrid(np.arange(17.0), np.arange(17.0)), axis=-1).reshape(-1, 2)
    errors = 36.0 * np.exp(-cdist(xy, xy) / 500.0) + 16.0 * np.eye(len(xy))
    drawn = np.linalg.cholesky(errors) @ rng.standard_normal((len(xy), 400))
    transform = Affine(30.0, 0.0, 0.0, 0.0, -30.0, 0.0)
    middle = [scales[2].slope_deg(Dem(z.reshape(17, 17), transform, CRS))[8, 8] for z in drawn.T]
    rise = np.sqrt(np.mean(np.tan(np.radians(middle)) ** 2) / 2.0)
    assert np.degrees(np.arctan(rise)) == pytest.approx(scales[2].tilt_deg, rel=0.1)


def test_a_product_without_a_limit_of_slope_is_refused() -> None:
    with pytest.raises(ConfigError, match="limit of slope"):
        validated(RoverLimits, {"slope_product": "aster-30"}, "the options")
    with pytest.raises(ConfigError, match="aster-30"):
        validated(RoverLimits, {"max_pitch_deg": 20.0, "slope_product": "aster"}, "the options")
