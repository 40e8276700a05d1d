"""Simulated scans lie on the real terrain, up to the errors of the scanner."""

import numpy as np
import pytest

from sim.config.sensors import LidarConfig
from sim.instruments.lidar import scans_along
from sim.vehicle.motion import exact_drive
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Leg, Route
from survey.data.sensors.lidar import LidarScans
from survey.reconstruction.line_of_sight.config import ScanPointsConfig
from survey.reconstruction.line_of_sight.scan_points import PathInterpolator, place_scans

GRID = Grid((0.0, 0.0, 60.0, 60.0), 2.0)
ROUTE = Route((Leg("swath", [[15.0, 30.0], [40.0, 32.0]]),), GRID.crs, "line")
PERFECT = LidarConfig(
    beams=8,
    columns=64,
    range_sigma_m=1e-6,
    divergence_deg=0.0,
    mounting_sigma_deg=0.0,
    dropped_share=0.0,
    ghost_share=0.0,
    spray_share=0.0,
)


def terrain() -> Dem:
    east, north = np.meshgrid(GRID.x, GRID.y)
    return Dem.on(GRID, np.sin(east / 6.0) + 0.5 * np.cos(north / 5.0))


def scans(config: LidarConfig, seed: int = 3) -> LidarScans:
    motion, _ = exact_drive(terrain(), ROUTE, 1.0, 0.1)
    return scans_along(motion, terrain(), config, seed)


def heights_above_ground(drawn: LidarScans) -> FloatArray:
    """Return how far above the ground the returns lie by the real path."""
    motion, _ = exact_drive(terrain(), ROUTE, 1.0, 0.1)
    placed = place_scans(drawn, PathInterpolator(motion), ScanPointsConfig(nearest_m=0.1))
    xyz = np.vstack([scan.xyz for scan in placed])
    above: FloatArray = xyz[:, 2] - terrain().at(xyz[:, :2])
    return above


def test_a_perfect_scanner_returns_the_ground_while_the_rover_moves() -> None:
    drawn = scans(PERFECT)
    assert len(drawn) == 12
    assert np.abs(heights_above_ground(drawn)).max() < 2e-3  # ranges are whole millimetres


def test_the_mounting_errs_by_one_angle_for_the_drive() -> None:
    tilted = heights_above_ground(scans(PERFECT.model_copy(update={"mounting_sigma_deg": 1.0})))
    assert 0.02 < np.abs(tilted).mean() < 1.0


def test_returns_are_lost_by_their_share() -> None:
    kept = [len(scans(PERFECT.model_copy(update={"dropped_share": s})).minutes[0].scan) for s in (0.0, 0.5)]
    assert kept[1] == pytest.approx(0.5 * kept[0], rel=0.05)


def test_grazing_ground_far_away_returns_nothing() -> None:
    far, near = (scans(PERFECT.model_copy(update={"reach_m": reach})).minutes[0] for reach in (250.0, 20.0))
    assert far.range_mm.max() > 15_000
    assert near.range_mm.max() < 15_000


def test_snow_and_ghosts_are_returned_where_there_is_no_ground() -> None:
    disturbed = PERFECT.model_copy(update={"spray_share": 0.2, "ghost_share": 0.1})
    ranges = [scans(config).minutes[0].range_mm for config in (PERFECT, disturbed)]
    assert ranges[0].min() > 4_000
    assert 0.1 < np.mean(ranges[1] < 4_000) < 0.3


def test_a_minute_is_the_same_whenever_it_is_drawn() -> None:
    first, second = scans(LidarConfig(beams=4, columns=32)), scans(LidarConfig(beams=4, columns=32))
    assert first == second
    assert first != scans(LidarConfig(beams=4, columns=32), seed=4)


def test_the_clock_of_the_scanner_may_be_off() -> None:
    late = scans(PERFECT.model_copy(update={"clock_offset_s": 0.25}))
    assert late.time_s == pytest.approx(scans(PERFECT).time_s + 0.25)


def test_beams_are_given_from_the_lowest_to_the_highest() -> None:
    with pytest.raises(ConfigError, match="4 to -18"):
        LidarConfig(elevation_deg=(4.0, -18.0))
