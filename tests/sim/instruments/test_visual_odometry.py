"""Drawn visual odometry: what comes with a landmark, and errors that landmarks share."""

import numpy as np

from planners import LawnmowerConfig
from sim.config.mission import MismatchConfig, MissionConfig, SensorConfig
from sim.config.world import RandomTerrain
from sim.instruments.sensor import StatisticalDrive
from sim.instruments.visual_measurements import draw_sightings
from sim.vehicle.motion import exact_drive
from survey import Dem, Grid, Route
from survey.data.route import Leg
from survey.data.sensors.odometry import Sightings

GRID = Grid((0.0, 0.0, 300.0, 100.0), 5.0)
FLAT = Dem.on(GRID, np.zeros(GRID.shape))


def sightings(mismatch: MismatchConfig | None = None, **sensors: object) -> Sightings:
    """Landmarks of a straight drive of 240 m on level ground."""
    mission = MissionConfig(
        schema_version=1,
        name="m",
        seed=5,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=2),
        sensors=SensorConfig.model_validate({"landmarks_per_m": 20.0} | sensors),
        mismatch=mismatch or MismatchConfig(),
    )
    route = Route((Leg("swath", [[10.0, 50.0], [250.0, 50.0]]),), GRID.crs, "line")
    trajectory, attitude = exact_drive(FLAT, route, 1.0)
    return draw_sightings(StatisticalDrive(FLAT, route, trajectory, attitude, mission))


def camera_rays(seen: Sightings) -> np.ndarray:
    return seen.offset - [0.0, 0.0, 0.7]


def test_range_and_covariance_are_those_of_the_measured_place() -> None:
    seen = sightings()
    ray = camera_rays(seen)
    distance = np.linalg.norm(ray, axis=1)
    np.testing.assert_allclose(seen.range_m, distance)
    along = np.einsum("ni,nij,nj->n", ray, seen.covariance, ray) / distance**2
    np.testing.assert_allclose(np.sqrt(along), 0.02 + 0.002 * distance**2)


def test_claimed_errors_differ_from_drawn_ones_by_the_ratio_of_the_mismatch() -> None:
    truthful, bold = sightings(), sightings(MismatchConfig(landmark_ratio=(0.5, 0.5)))
    np.testing.assert_array_equal(bold.offset, truthful.offset)
    np.testing.assert_allclose(bold.covariance, 0.25 * truthful.covariance)


def test_far_landmarks_lie_too_high_by_the_stated_bias() -> None:
    lifted = sightings(landmark_far_bias_m=0.08).offset[:, 2] - sightings().offset[:, 2]
    distance = sightings().range_m  # measured: true ones differ by up to a metre
    np.testing.assert_allclose(lifted[distance > 18.0], 0.08)
    np.testing.assert_allclose(lifted[distance < 8.0], 0.0)


def test_landmarks_of_one_stretch_of_travel_share_an_error_of_height() -> None:
    shared = sightings(landmark_shared_sigma_m=0.03)
    lifted = shared.offset[:, 2] - sightings().offset[:, 2]
    stretch = shared.pose // 5  # a pose each metre, a stretch each five
    spread = [np.ptp(lifted[stretch == k]) for k in np.unique(stretch)]
    assert max(spread) < 1e-12
    # 48 stretches: 10 % of a standard deviation, taken three times.
    first = [lifted[stretch == k][0] for k in np.unique(stretch)]
    assert abs(np.std(first) / 0.03 - 1.0) < 0.3
