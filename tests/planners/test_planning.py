import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from planners import (
    BestConfig,
    LawnmowerConfig,
    PiecewiseContinuousConfig,
    RandomWanderConfig,
    Rover,
    VarianceDrivenConfig,
    WavyConfig,
    plan,
)
from planners.registry import PlannerConfig
from survey import Dem, Grid, InputError, Route, SurveyArea
from survey.reconstruction.gp.kernels import SquaredExponential

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)
KERNEL = SquaredExponential(30.0, 150.0)
EVERY_PATTERN = [
    LawnmowerConfig(swaths=3),
    LawnmowerConfig(swaths=3, inset_share=0.5, tie_lines=1),
    WavyConfig(swaths=3),
    PiecewiseContinuousConfig(swaths=2),
    RandomWanderConfig(swaths=2),
    VarianceDrivenConfig(budget_m=1200.0, n_places=5),
    BestConfig(swaths=3),
]


@pytest.mark.parametrize("config", EVERY_PATTERN, ids=lambda config: config.pattern)
def test_every_pattern_plans_by_the_one_entry(config, tmp_path):
    route = plan(SITE, None, config, kernel=KERNEL, sample_step_m=20.0)
    assert SITE.free.covers(route.line)
    assert route.prediction["length_m"] == pytest.approx(route.ground_length_m)
    assert route.prediction["time_s"] >= route.prediction["length_m"]
    route.write(tmp_path / "route.geojson")
    again = Route.read(tmp_path / "route.geojson")
    assert again.length_m == pytest.approx(route.length_m, abs=1e-3)


@pytest.mark.parametrize("config", EVERY_PATTERN, ids=lambda config: config.pattern)
def test_plans_are_the_same_every_time(config):
    first, second = (plan(SITE, None, config, kernel=KERNEL, sample_step_m=20.0) for _ in range(2))
    assert first.path().tolist() == second.path().tolist()


@pytest.mark.parametrize("config", EVERY_PATTERN, ids=lambda config: config.pattern)
def test_patterns_are_distinguished_by_their_name(config):
    values = config.model_dump(mode="json", exclude_none=True)
    assert TypeAdapter(PlannerConfig).validate_python(values) == config


def test_a_prior_gives_the_slopes_for_time_and_energy():
    grid = Grid((0.0, 0.0, 600.0, 600.0), 20.0, CRS)
    climb = Dem.on(grid, np.broadcast_to(0.2 * grid.x, grid.shape))
    level, steep = (plan(SITE, prior, LawnmowerConfig(swaths=3)).prediction for prior in (None, climb))
    assert steep["length_m"] == level["length_m"]
    assert steep["time_s"] > level["time_s"]
    assert steep["energy_j"] != level["energy_j"]


def test_a_prior_with_gaps_leaves_the_ground_level():
    elevation = np.full((31, 31), 5.0)
    elevation[10:20, 10:20] = np.nan
    prior = Dem.on(Grid((0.0, 0.0, 600.0, 600.0), 20.0, CRS), elevation)
    with_gaps, without = (plan(SITE, p, LawnmowerConfig(swaths=3)).prediction for p in (prior, None))
    assert dict(with_gaps) == dict(without) | {"prior_covered_share": with_gaps["prior_covered_share"]}
    assert with_gaps["prior_covered_share"] == pytest.approx(1.0 - (100 / 961), abs=0.02)


def test_slow_rovers_take_longer():
    fast, slow = (
        plan(SITE, None, LawnmowerConfig(swaths=3), rover=Rover(speed_m_s=v)).prediction["time_s"]
        for v in (2.0, 0.5)
    )
    assert slow > fast


def test_concave_ground_is_cut_and_joined_around_the_bay():
    bay = shapely.Polygon(
        [(0, 0), (600, 0), (600, 600), (350, 600), (350, 200), (250, 200), (250, 600), (0, 600)]
    )
    area = SurveyArea(bay, CRS)
    route = plan(area, None, LawnmowerConfig(spacing_m=50.0))
    assert area.free.covers(route.line)
    swept = shapely.union_all([shapely.linestrings(s.xy).buffer(25.0 + 1e-6) for s in route.swaths])
    assert area.free.difference(swept).area < 1e-3 * area.free.area


def test_waves_keep_their_axes_through_the_ordering():
    area = SurveyArea(SITE.polygon, CRS, no_go=(shapely.box(250.0, 250.0, 350.0, 350.0),))
    route = plan(area, None, WavyConfig(swaths=6, wavelength_m=90.0))
    for swath in route.swaths:
        along = swath.axis[1] - swath.axis[0]
        across = np.abs((swath.xy - swath.axis[0]) @ [-along[1], along[0]]) / np.hypot(*along)
        assert across.max() <= 0.25 * route.spacing_m + 1e-6


@given(
    turn_deg=st.floats(-180.0, 180.0),
    shift=st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)),
    sides=st.tuples(st.floats(300.0, 900.0), st.floats(100.0, 290.0)),
)
@settings(max_examples=25)
def test_turning_and_shifting_a_site_turns_and_shifts_its_swaths(turn_deg, shift, sides):
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    rotation = np.array([[c, s], [-s, c]])
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * sides
    moved = SurveyArea(shapely.Polygon(corners @ rotation + shift), CRS)
    here, there = (
        plan(area, None, WavyConfig(swaths=3, wavelength_m=130.0))
        for area in (SurveyArea(shapely.Polygon(corners), CRS), moved)
    )
    # Clipping at slanted borders may take a millimetre at each end.
    assert there.length_m == pytest.approx(here.length_m, abs=0.05)
    back = [np.sort((swath.axis - shift) @ rotation.T, axis=0) for swath in there.swaths]
    middles = sorted(axis.mean(axis=0)[1] for axis in back)
    assert middles == pytest.approx(sorted(swath.axis[0, 1] for swath in here.swaths), abs=0.01)


def test_a_planner_that_leaves_the_area_is_found_out(monkeypatch):
    from planners.planning import planner_of

    planner = planner_of(LawnmowerConfig(swaths=3))
    north = SurveyArea.rectangle((0.0, 300.0, 600.0, 900.0), CRS)
    astray = plan(north, None, LawnmowerConfig(swaths=3))
    monkeypatch.setattr("planners.planning.planner_of", lambda _: _Astray(planner, astray))
    with pytest.raises(InputError, match="the planned route is outside the area"):
        plan(SITE, None, LawnmowerConfig(swaths=3))


class _Astray:
    def __init__(self, planner, route):
        self._planner, self._route = planner, route

    def __getattr__(self, name):
        return getattr(self._planner, name)

    def layout(self, *_):
        return self._route
