"""`--epoch` of localize, reconstruct and score on moving ice."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from sim.config.world import IceConfig
from sim.simulate.simulation import simulate_statistical
from survey import Dem, Grid, Leg, Reconstruction, Route
from survey.data.ice_motion import read_motion
from survey.reconstruction.motion.epoch import AGE
from tests.sim.small_missions import mission_with

CRS = "EPSG:32608"


@pytest.fixture
def drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dem:
    """A recording of two swaths in ten hours on ice that moves by 4 m a day; returns its terrain at 5 h."""
    grid = Grid((0.0, 0.0, 120.0, 80.0), 2.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    corners = np.array([[30.0, 30.0], [90.0, 30.0], [90.0, 50.0], [30.0, 50.0]])
    kinds = "swath", "transit", "swath"
    legs = [Leg(kind, ends) for kind, *ends in zip(kinds, corners, corners[1:], strict=False)]
    route = Route(tuple(legs), CRS, "lawnmower", 20.0)
    at_ease = mission_with(stakes=3, recognition=1.0, base_station=True)
    ice = IceConfig(velocity_m_per_day=4.0, melt_m_per_day=0.06, pose_interval_s=200.0, stake_surveys=4)
    rover = at_ease.rover.model_copy(update={"speed_m_s": 140.0 / 36000.0})
    mission = at_ease.model_copy(update={"rover": rover, "ice": ice})
    terrain = Dem.on(grid, 3.0 * np.sin(x / 15.0) * np.cos(y / 12.0))
    recording, truth = simulate_statistical(terrain, route, mission)
    recording.write(tmp_path / "recording")
    monkeypatch.chdir(tmp_path)
    truth.dem.write("truth.tif")
    return truth.dem


def said(*words: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == code, done.output
    return " ".join(done.output.split())


@pytest.mark.usefixtures("drive")
def test_path_map_and_score_are_those_of_the_epoch() -> None:
    summary = said("localize", "recording", "--epoch", "18000", "-q")
    assert "ice speed" in summary
    motion = read_motion("localization/ice_motion.json")
    off = motion.rates(motion.origin_m[None])[0, :2] - [4.0, 0.0]
    assert (np.abs(off) < 4.0 * motion.rates_sigma(motion.origin_m[None])[0, :2]).all()
    command = ["reconstruct", "localization/landmarks.gpkg", "--method", "joint", "--grid", "4"]
    command += ["--set", "reconstruction.gp.fit=false", "--set", "reconstruction.gp.length_scale_m=12"]
    command += ["--set", "reconstruction.gp.variance_m2=4"]
    command += ["--trajectory", "localization/trajectory.csv", "-q"]
    assert "left as it is" in said(*command)
    assert "left as it is" in said("score", "reconstruction", "--truth", "truth.tif")
    later = said(*command, "--epoch", "61200", "-o", "later")
    assert "the map is that of 17.0 h" in later
    moved = Reconstruction.read("later")
    assert moved.diagnostics[AGE]["epoch_s"] == 61200.0
    assert read_motion("later/ice_motion.json").epoch_s == 61200.0
    said("score", "later", "--truth", "truth.tif", "--epoch", "18000")


@pytest.mark.usefixtures("drive")
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["localize", "recording", "--set", "ice.velocity_sigma_m_per_day=1"], "add --epoch"),
        (["score", "truth.tif", "--truth", "reference.tif", "--epoch", "0"], "holds no ice_motion.json"),
        (
            ["reconstruct", "recording/sightings.csv", "--epoch", "0"],
            "no ice_motion.json stands beside a trajectory",
        ),
    ],
)
def test_an_epoch_without_a_motion_is_refused(words: list[str], sentence: str) -> None:
    Path("reference.tif").touch()
    assert sentence in said(*words, code=3)


@pytest.mark.usefixtures("drive")
def test_velocity_rasters_are_the_prior_of_localization() -> None:
    grid = Grid((-400.0, -400.0, 500.0, 500.0), 100.0, CRS)
    for name, value in (("vx", 4.0), ("vy", 0.0), ("sx", 0.01), ("sy", 0.01)):
        Dem.on(grid, np.full(grid.shape, value)).write(f"{name}.tif")
    files = 'ice.velocity_files=["vx.tif", "vy.tif", "sx.tif", "sy.tif"]'
    said("localize", "recording", "--epoch", "18000", "--set", files, "-q")
    motion = read_motion("localization/ice_motion.json")
    assert (motion.rates_sigma(motion.origin_m[None])[0, :2] < 0.0101).all()
