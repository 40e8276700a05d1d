"""Science payload of a mission: logged on every drive, mapped, judged; the field is that of the site for all rovers."""

from pathlib import Path

import numpy as np
import pytest

from sim.config.mission import MissionConfig
from sim.config.rover import PayloadConfig
from sim.instruments.environment import PayloadField, payload_log
from sim.mission.derived_maps import logs_of
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from survey import Dem, Grid, Reconstruction
from survey.core.config import validated
from survey.core.documents import read_json
from survey.core.errors import ConfigError
from survey.data.trajectory import Trajectory
from survey.data.truth import Truth
from survey.reconstruction.gp.kernels import Matern52

WARM = {"name": "air_temperature", "unit": "degC", "per_km_of_elevation": -6.5, "field_length_m": 60.0}
MISSION = {
    "schema_version": 1,
    "name": "payload",
    "fidelity": "ideal",
    "terrain": {"source": "random", "size_m": 150.0, "step_m": 3.0, "origin_m": (500000.0, 6700000.0)},
    "area": {"starts_m": ((500010.0, 6700010.0),)},
    "planner": {"pattern": "lawnmower", "swaths": 4},
    "fleet": {"rovers": 2},
    "payload": (WARM,),
    "reconstruction": {
        "grid_step_m": 8.0,
        "gp": {"fit": False, "variance_m2": 25.0, "length_scale_m": 60.0, "calibrate": False},
    },
}
GRID = Grid((0.0, 0.0, 400.0, 400.0), 5.0, "EPSG:32608")


def config(**changes: object) -> PayloadConfig:
    return PayloadConfig(**{**WARM, **changes})  # type: ignore[arg-type]


def slope(per_m: float = 0.0) -> Dem:
    return Dem.on(GRID, per_m * np.meshgrid(GRID.x, GRID.y)[1])


def straight(length_m: float) -> Truth:
    """Drive to the east at 1 m/s."""
    time_s = np.arange(0.0, length_m)
    n = len(time_s)
    position = np.column_stack([time_s, np.full(n, 200.0), np.zeros(n)])
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    return Truth(slope(), Trajectory(time_s, position, turn, np.zeros((n, 3, 3)), GRID.crs))


def test_short_relief_of_every_field_is_that_of_its_covariance_function():
    """Third differences over half a length scale: on each site as large as those of a Gaussian process."""
    line, weights = np.column_stack([np.arange(4.0), np.zeros(4)]), np.array([1.0, -3.0, 3.0, -1.0])
    expected = weights @ Matern52(1.0, 2.0).covariance(line, line) @ weights
    xy = np.random.default_rng(0).uniform(5.0, 390.0, (500, 2))
    for seed in range(4):
        field = PayloadField(config(field_length_m=2.0, per_km_of_elevation=0.0), slope(), seed)
        differences = sum(w * field.at(xy + step) for w, step in zip(weights, line, strict=True))
        assert np.mean(np.square(differences)) == pytest.approx(expected, rel=0.3)


def test_a_fleet_maps_what_its_payloads_measured(tmp_path: Path):
    run = open_run(validated(MissionConfig, MISSION, "the test"), tmp_path)
    run_mission(validated(MissionConfig, MISSION, "the test"), run, until="score", workers=1)
    score = read_json(run.folder("score") / "payload.json", "the scores")["air_temperature"]
    assert score["rmse"] < 0.5
    assert 0.0 < score["scc"] <= 1.0
    mapped = Reconstruction.read(run.folder("reconstruct") / "payload" / "air_temperature")
    assert mapped.quantity == "air_temperature_degC"
    assert len(logs_of(run, config())) == 2


def test_a_field_has_the_spread_and_the_lapse_that_are_stated():
    still = PayloadField(config(field_sd=0.0, mean=-4.0), slope(0.1), 3)
    top, foot = still.at(np.array([[200.0, 395.0], [200.0, 5.0]]))
    assert top - foot == pytest.approx(-6.5 * 0.039)
    values = [PayloadField(config(per_km_of_elevation=0.0), slope(), seed).at(GRID.xy) for seed in range(10)]
    assert np.std(values) == pytest.approx(1.0, rel=0.2)


def test_ground_that_faces_south_has_its_surplus():
    facing = config(field_sd=0.0, per_km_of_elevation=0.0, facing_south=2.0)
    rising_to_the_north = PayloadField(facing, slope(1.0), 1).at(np.array([[200.0, 200.0]]))
    assert rising_to_the_north[0] == pytest.approx(2.0 * np.sin(np.radians(45.0)), rel=1e-3)


def test_a_sensor_lags_by_its_time_constant_and_has_its_noise():
    truth = straight(390.0)
    quick, slow = config(noise_sd=1e-6), config(noise_sd=1e-6, lag_s=10.0)
    field = PayloadField(quick, truth.dem, 5)
    there, lagged = (payload_log(one, field, truth, 1).value for one in (quick, slow))
    np.testing.assert_allclose(lagged[60:], there[50:-10], atol=0.25)
    assert np.abs(lagged[60:] - there[60:]).max() > 0.1
    noisy = payload_log(config(noise_sd=0.3), field, truth, 1).value
    assert np.std(noisy - there) == pytest.approx(0.3, rel=0.15)


def test_a_quantity_that_is_measured_twice_is_refused():
    with pytest.raises(ConfigError, match="air_temperature twice"):
        validated(MissionConfig, MISSION | {"payload": (WARM, WARM)}, "the test")
