import numpy as np
import pytest

from sim.config.world import IceConfig
from sim.world.moving_ice import MovingIce
from survey import Dem, Grid

CRS, DAY_S = "EPSG:32608", 86400.0


def ice(**settings: object) -> MovingIce:
    return MovingIce(IceConfig(**settings), np.array([100.0, 100.0]))


def test_places_of_the_start_are_found_again():
    flow = ice(velocity_m_per_day=4.0, direction_deg=30.0, flow="valley", half_width_m=120.0)
    starts = np.random.default_rng(2).uniform(0.0, 200.0, (30, 2))
    times = np.linspace(0.0, 2.0 * DAY_S, 30)
    now = starts + flow.displacement(starts, times)[:, :2]
    np.testing.assert_allclose(flow.starts(now, times), starts, atol=1e-4)


def test_a_valley_glacier_is_slow_at_its_margins():
    flow = ice(
        velocity_m_per_day=2.0, direction_deg=0.0, flow="valley", half_width_m=100.0, margin_share=0.25
    )
    speed = flow.velocities(np.array([[0.0, 100.0], [0.0, 150.0], [0.0, 200.0]]))[:, 0]
    # Half way to the margin 1 - (1/2)^4 of the deformation is left.
    np.testing.assert_allclose(speed, [2.0, 2.0 * (0.25 + 0.75 * 15.0 / 16.0), 0.5])


def test_melt_over_a_day_is_its_mean_whatever_the_cycle():
    for share in (0.0, 1.0):
        melted = ice(melt_m_per_day=0.08, diurnal_share=share).lowering(np.array([0.0, DAY_S]))
        np.testing.assert_allclose(melted, [0.0, 0.08], atol=1e-12)


def test_melt_is_fastest_in_the_afternoon():
    melting = ice(melt_m_per_day=0.08, diurnal_share=1.0, start_hour=8.0)
    afternoon, night = (
        np.diff(melting.lowering(3600.0 * np.array(hours)))[0] for hours in ([5.0, 7.0], [17.0, 19.0])
    )
    assert afternoon > 10.0 * night


def test_the_terrain_is_carried_on_and_lowered():
    grid = Grid((0.0, 0.0, 200.0, 200.0), 5.0, CRS)
    plane = Dem.on(grid, 0.1 * np.tile(grid.x, (len(grid.y), 1)))
    later = ice(velocity_m_per_day=3.0, melt_m_per_day=0.05).terrain_at(plane, DAY_S)
    # A plane that rises by 0.1 to the east and moves 3 m there is 0.3 m lower.
    inside = (slice(None), slice(2, -2))
    np.testing.assert_allclose(later.elevation[inside] - plane.elevation[inside], -0.35, atol=1e-9)


def test_two_flows_are_refused():
    with pytest.raises(ValueError, match="exclude one another"):
        IceConfig(velocity_m_per_day=1.0, velocity_files=("vx.tif", "vy.tif"))
