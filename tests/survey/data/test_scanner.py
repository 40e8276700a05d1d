"""Geometry of a spinning LiDAR."""

import numpy as np
import pytest

from survey.data.sensors.lidar import Scanner


def test_rays_are_unit_vectors_at_the_elevations_of_the_beams():
    rays = Scanner(elevation_deg=(10.0, 0.0, -20.0), n_columns=8).rays()
    assert rays.shape == (8, 3, 3)
    assert np.linalg.norm(rays, axis=2) == pytest.approx(1.0)
    assert np.degrees(np.arcsin(rays[..., 2])) == pytest.approx(np.tile([10.0, 0.0, -20.0], (8, 1)))


def test_columns_turn_counter_clockwise_from_ahead():
    rays = Scanner(elevation_deg=(0.0,), n_columns=4).rays()[:, 0]
    assert rays == pytest.approx(np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]), abs=1e-12)


def test_the_hdl_64_has_64_beams_over_27_degrees():
    scanner = Scanner.hdl_64()
    assert len(scanner.elevation_deg) == 64
    assert max(scanner.elevation_deg) - min(scanner.elevation_deg) == pytest.approx(26.33)
