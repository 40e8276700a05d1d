"""Attitude that a rover senses while a pattern is steered."""

import numpy as np

import planners
from planners import PiecewiseContinuousConfig
from sim.config.mission import MissionConfig, SensorConfig
from sim.config.world import RandomTerrain
from sim.mission.drives import _steering_on_the_way, steered
from sim.simulate.simulation import sensed_attitude, sensed_attitudes
from sim.world.site import build_world

NO_ERRORS = {"tilt_sigma_deg": 0.0, "gps_bias_sigma_m": 0.0}


def level(_: np.ndarray, heading: np.ndarray) -> planners.Attitude:
    return planners.Attitude(0.0 * heading, 0.0 * heading, heading)


def mission(fidelity: str = "statistical", **sensors: float) -> MissionConfig:
    return MissionConfig(
        schema_version=1,
        name="m",
        seed=4,
        fidelity=fidelity,
        terrain=RandomTerrain(source="random", size_m=300.0, step_m=3.0, relief_m=12.0, length_scale_m=60.0),
        planner=PiecewiseContinuousConfig(swaths=2),
        sensors=SensorConfig(**sensors),
    )


def angles_deg(config: MissionConfig, n: int = 4000) -> np.ndarray:
    """Roll and pitch (n, 2) that are sensed on level ground, one a metre."""
    sense = sensed_attitude(level, config)
    sensed = [sense(np.array([[float(k), 0.0]]), np.zeros(1)) for k in range(n)]
    return np.degrees([[one.roll_rad[0], one.pitch_rad[0]] for one in sensed])


def test_roll_and_pitch_err_by_their_stated_size_over_their_stated_length() -> None:
    found = angles_deg(mission(tilt_sigma_deg=0.8, attitude_correlation_m=20.0))
    # 200 independent lengths of 20 m, two angles: 5 % of a standard deviation, taken three times.
    assert abs(found.std() / 0.8 - 1.0) < 0.15
    neighbours = np.mean(found[1:] * found[:-1]) / np.mean(found**2)
    assert abs(neighbours - np.exp(-1.0 / 20.0)) < 0.02


def test_ground_is_sensed_at_the_real_place() -> None:
    places = []

    def sense(xy: np.ndarray, heading: np.ndarray) -> planners.Attitude:
        places.append(xy[0].copy())
        return level(xy, heading)

    sensed = sensed_attitude(sense, mission(gps_bias_sigma_m=2.0, gps_correlation_time_s=50.0))
    for k in range(3000):
        sensed(np.array([[float(k), 0.0]]), np.zeros(1))
    beside = np.array(places) - np.column_stack([np.arange(3000.0), np.zeros(3000)])
    # 60 independent times, two axes: 9 % of a standard deviation, taken three times.
    assert abs(beside.std() / 2.0 - 1.0) < 0.27


def test_the_route_follows_what_is_sensed_and_not_the_ground_itself() -> None:
    driven = {}
    for name, config in {
        "ideal": mission("ideal"),
        "exact": mission(**NO_ERRORS),
        "errors": mission(tilt_sigma_deg=2.0),
    }.items():
        world = build_world(config)
        route = planners.plan(world.area, world.prior, config.planner, rover=config.rover)
        driven[name] = np.vstack([leg.xy for leg in steered(route, world, config).legs])
    np.testing.assert_array_equal(driven["exact"], driven["ideal"])
    assert (
        driven["errors"].shape != driven["ideal"].shape
        or np.abs(driven["errors"] - driven["ideal"]).max() > 1.0
    )


def test_errors_of_a_rover_do_not_depend_on_others_nor_on_waiting_for_them() -> None:
    sensors = SensorConfig(tilt_sigma_deg=1.0)

    def driven(ways: list[np.ndarray], seeds: list[int]) -> np.ndarray:
        sense = sensed_attitudes(level, sensors, 1.0, [np.random.default_rng(seed) for seed in seeds])
        return np.array(
            [sense(np.array(here), np.zeros(len(here))).roll_rad for here in zip(*ways, strict=True)]
        )

    straight = np.column_stack([10.0 * np.arange(8.0), np.zeros(8)])
    waiting = straight[[0, 1, 2, 2, 2, 3, 4, 5]]
    alone, beside = driven([straight], [3])[:, 0], driven([waiting, straight], [5, 3])
    np.testing.assert_array_equal(beside[:, 1], alone)
    np.testing.assert_array_equal(beside[[0, 1, 2, 5, 6, 7], 0], driven([straight], [5])[:6, 0])


def test_a_mission_in_images_chooses_a_steered_path_while_it_drives_off_the_terrains_edge() -> None:
    config = mission("vision")
    world = build_world(config)
    route = planners.plan(world.area, world.prior, config.planner, rover=config.rover)
    steering = _steering_on_the_way(route, world, config, 3.0)
    assert steering is not None
    _, south, _, north = world.terrain.bounds
    left_up = planners.Attitude(np.array([0.2]), np.zeros(1), np.zeros(1))
    places = [steering.start]
    while (stretch := steering.next_stretch(left_up)) is not None:
        places += list(stretch)
    # Bands reach half a spacing, which is the border here, to either side of the swaths.
    aside = np.array(places)[:, 1]
    assert south + 2.99 <= aside.min()
    assert aside.max() <= north - 2.99
    fixed = config.model_copy(update={"planner": planners.LawnmowerConfig(swaths=2)})
    assert _steering_on_the_way(route, world, fixed, 3.0) is None
