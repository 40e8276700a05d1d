"""A rover that scans, and changes its route before it reaches lethal ground."""

import numpy as np

from planners.look_ahead import LookAheadSettings
from sim.config.sensors import LidarConfig
from sim.simulate.look_ahead_drive import LethalGround, PoseErrors, drive_with_look_ahead
from survey import Dem, Grid, Leg, Route, SurveyArea

LIDAR = LidarConfig(beams=24, columns=240, elevation_deg=(-35.0, 3.0), range_m=20.0)


def test_a_crevasse_across_a_swath_is_driven_around() -> None:
    grid = Grid((0.0, 0.0, 50.0, 36.0), 0.25, "EPSG:32608")
    x, y = np.meshgrid(grid.x, grid.y)
    z = 0.05 * x + 0.05 * np.sin(x / 3.0) * np.cos(y / 2.0)
    terrain = Dem.on(grid, np.where((np.abs(x - 25.0) < 0.5) & (y > 12.0) & (y < 24.0), z - 4.0, z))
    route = Route((Leg("swath", [[6.0, 18.0], [44.0, 18.0]]),), "EPSG:32608", "line")
    area = SurveyArea.rectangle((2.0, 2.0, 48.0, 34.0), "EPSG:32608")
    settings = LookAheadSettings()
    lethal = LethalGround(terrain, settings.limit)
    assert lethal.entries(np.column_stack([np.arange(6.0, 44.0, 0.1), np.full(380, 18.0)])) == 1
    drives = [
        drive_with_look_ahead(
            terrain, route, area, LIDAR, stated=LIDAR, settings=settings, errors=PoseErrors(), seed=seed
        )
        for seed in (1, 1)
    ]
    assert drives[0].n_entries == 0
    assert drives[0].driven_m < 2.0 * drives[0].planned_m
    assert np.hypot(*(drives[0].xy[-1] - [44.0, 18.0])) < 2.0
    assert np.array_equal(drives[0].xy, drives[1].xy)
