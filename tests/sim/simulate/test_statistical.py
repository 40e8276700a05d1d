import numpy as np
import pytest

from planners import LawnmowerConfig
from sim.config.mission import MissionConfig
from sim.config.world import RandomTerrain
from sim.simulate.simulation import simulate_statistical
from survey import Dem, Grid, InputError, Leg, Route
from survey.reconstruction.line_of_sight.returns import checked_origins
from vision_slam import localize, trajectory_error
from vision_slam.attitude import rotations

CRS = "EPSG:32608"


def rolling_ground(size_m: float = 400.0) -> Dem:
    grid = Grid((0.0, 0.0, size_m, size_m), 2.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, 4.0 * np.sin(x / 60.0) * np.cos(y / 45.0) + 0.03 * x)


def hairpin(size_m: float = 400.0) -> Route:
    rows = [
        Leg("swath", [[5.0, 100.0], [size_m - 5.0, 100.0]]),
        Leg("transit", [[size_m - 5.0, 100.0], [size_m - 5.0, 300.0]]),
        Leg("swath", [[size_m - 5.0, 300.0], [5.0, 300.0]]),
    ]
    return Route(tuple(rows), CRS, "lawnmower", 200.0)


def mission(seed: int, **sensors: float) -> MissionConfig:
    config = MissionConfig(
        schema_version=1,
        name="m",
        seed=seed,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=2),
    )
    return config.model_copy(update={"sensors": config.sensors.model_copy(update=sensors)})


@pytest.mark.long
@pytest.mark.parametrize(
    ("n_drives", "slack"), [(10, 1.5), pytest.param(30, 1.2, marks=pytest.mark.exhaustive)]
)
def test_claimed_path_errors_match_real_ones_over_many_drives(n_drives, slack):
    # As many drives are as many draws of the shared errors; the mean of eᵀP⁻¹e along a drive is 3 when
    # P is honest. Its scatter between drives is about 2, so the mean of 10 errs by 0.6, that of 30 by 0.4.
    squared, elevation = [], []
    for seed in range(n_drives):
        settings = mission(seed)
        recording, truth = simulate_statistical(rolling_ground(), hairpin(), settings)
        result = localize(recording, settings.assumed)
        trajectory, points = result.trajectory, result.points
        squared.append(trajectory_error(trajectory, truth.trajectory).normalised_squared)
        error = points.z - truth.dem.at(points.xy)
        elevation.append(np.nanmean((error / points.sigma_z) ** 2))
    assert 3.0 - slack < np.mean(squared) < 3.0 + slack
    # Landmarks carry the slope times their own place error besides, so somewhat more than 1.
    assert 0.6 < np.mean(elevation) < 1.5


def test_sightings_alone_are_as_sure_as_they_say():
    settings = mission(
        3,
        yaw_sigma_deg=0.0,
        tilt_sigma_deg=0.0,
        scale_sigma=0.0,
        step_sigma_m=0.0,
        gps_bias_sigma_m=0.0,
        gps_white_sigma_m=0.0,
    )
    recording, truth = simulate_statistical(rolling_ground(), hairpin(), settings)
    sightings = recording.sightings
    pose = truth.trajectory.position[sightings.pose]
    assert len(sightings.pose) > 500
    assert (sightings.range_m > 5.0 - 1.0).all()
    place = pose + np.einsum(
        "nij,nj->ni", rotations(recording.odometry.attitude_rad[sightings.pose]), sightings.offset
    )
    miss = place[:, 2] - truth.dem.at(place[:, :2])
    # On gentle slopes the miss is the error across the line of sight, 5 cm and 2.5 mm a metre, plus slope times depth.
    assert np.median(np.abs(miss)) < 0.12


def test_the_same_seed_gives_the_same_records_and_another_one_others():
    first, _ = simulate_statistical(rolling_ground(), hairpin(), mission(5))
    again, _ = simulate_statistical(rolling_ground(), hairpin(), mission(5))
    other, _ = simulate_statistical(rolling_ground(), hairpin(), mission(6))
    np.testing.assert_array_equal(first.gps.position, again.gps.position)
    np.testing.assert_array_equal(first.sightings.offset, again.sightings.offset)
    assert not np.array_equal(first.gps.position, other.gps.position)


def test_changing_one_sensor_leaves_the_draws_of_the_others():
    first, _ = simulate_statistical(rolling_ground(), hairpin(), mission(5))
    louder, _ = simulate_statistical(rolling_ground(), hairpin(), mission(5, gps_white_sigma_m=2.0))
    np.testing.assert_array_equal(first.odometry.step, louder.odometry.step)
    np.testing.assert_array_equal(first.sightings.offset, louder.sightings.offset)


def test_a_route_off_the_terrain_is_refused():
    with pytest.raises(InputError, match="leaves the known terrain"):
        simulate_statistical(rolling_ground(300.0), hairpin(400.0), mission(0))


def test_what_lies_behind_a_ridge_is_not_seen():
    grid = Grid((0.0, 0.0, 200.0, 100.0), 1.0, CRS)
    _, y = np.meshgrid(grid.x, grid.y)
    ridge = Dem.on(grid, 5.0 * np.exp(-(((y - 60.0) / 2.0) ** 2)))
    route = Route((Leg("swath", [[5.0, 50.0], [195.0, 50.0]]),), CRS, "line")
    recording, truth = simulate_statistical(ridge, route, mission(1, landmarks_per_m=20.0))
    sightings = recording.sightings
    turn = rotations(recording.odometry.attitude_rad[sightings.pose])
    place = truth.trajectory.position[sightings.pose] + np.einsum("nij,nj->ni", turn, sightings.offset)
    behind = place[:, 1] > 64.0
    in_front = place[:, 1] < 36.0  # the same distance on the open side
    assert in_front.sum() > 100
    # Errors along the line of sight may push a few of the crest's landmarks over it.
    assert behind.sum() < 0.1 * in_front.sum()


def test_landmarks_state_the_camera_as_origin_and_pass_the_check_of_lines_of_sight():
    settings = mission(3)
    recording, _ = simulate_statistical(rolling_ground(), hairpin(), settings)
    points = localize(recording, settings.assumed).points
    above = np.linalg.norm(checked_origins(points) - points.body, axis=1)
    np.testing.assert_allclose(above, settings.rover.camera_height_m, rtol=1e-9)
