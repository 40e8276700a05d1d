"""Steering of one rover, one stretch after another."""

import numpy as np
import pytest

from planners import PiecewiseContinuousConfig, RandomWanderConfig, plan
from planners.registry import steering_of
from planners.steered_paths import WaypointSteering, rollout
from planners.steering import Attitude, attitude_sensor
from survey import Dem, Grid, Route, SurveyArea

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 300.0, 200.0), CRS)
GRID = Grid((0.0, 0.0, 300.0, 200.0), 5.0, CRS)
LEVEL = Attitude(np.zeros(1), np.zeros(1), np.zeros(1))


def hills() -> Dem:
    x, y = np.meshgrid(GRID.x, GRID.y)
    return Dem.on(GRID, 5.0 * np.sin(x / 40.0) * np.cos(y / 30.0))


def driven(config: PiecewiseContinuousConfig | RandomWanderConfig, area: SurveyArea, seed: int) -> Route:
    """The route of a rover that senses its attitude exactly, where it takes itself to be."""
    sense = attitude_sensor(hills())
    steering = WaypointSteering(
        plan(area, None, config), steering_of(config), area.free, np.random.default_rng(seed)
    )
    here, heading = steering.start, 0.0
    while (stretch := steering.next_stretch(sense(here[None], np.array([heading])))) is not None:
        before = np.vstack([here[None], stretch])[-2]
        here = stretch[-1]
        heading = float(np.arctan2(*(here - before)[::-1]))
    return steering.driven()


@pytest.mark.parametrize("kind", [PiecewiseContinuousConfig, RandomWanderConfig])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_stretch_by_stretch_the_path_is_that_of_the_rollout(kind: type, seed: int) -> None:
    config = kind(swaths=2)
    sense, rngs = attitude_sensor(hills()), [np.random.default_rng(seed)]
    expected = rollout(SITE, plan(SITE, None, config), steering_of(config), sense, rngs)[0]
    found = driven(config, SITE, seed)
    assert [leg.kind for leg in found.legs] == [leg.kind for leg in expected.legs]
    for one, other in zip(found.legs, expected.legs, strict=True):
        np.testing.assert_allclose(one.xy, other.xy, atol=1e-6)
        np.testing.assert_array_equal(one.axis, other.axis)


def test_the_route_so_far_ends_at_the_last_waypoint() -> None:
    config = PiecewiseContinuousConfig(swaths=2)
    steering = WaypointSteering(
        plan(SITE, None, config), steering_of(config), SITE.free, np.random.default_rng(1)
    )
    for _ in range(3):
        stretch = steering.next_stretch(LEVEL)
    assert stretch is not None
    np.testing.assert_array_equal(steering.driven().path()[-1], stretch[-1])
    assert steering.driven().length_m == pytest.approx(30.0)
