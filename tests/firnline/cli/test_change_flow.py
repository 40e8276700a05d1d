"""`firnline change --flow`: change along the flow from tracked surveys, files and rasters."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid
from survey.data.ice_motion import write_motion
from survey.io.vector import write_features
from survey.reconstruction.motion.priors import uniform_motion

MELT_M = 0.8


@pytest.fixture
def pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two surveys of bumps: those of the western part move by 6 m to the east and melt."""
    grid = Grid((0.0, 0.0, 300.0, 300.0), 3.0, "EPSG:32608")
    ice, xy = shapely.box(30.0, 30.0, 180.0, 270.0), grid.xy
    waves = np.random.default_rng(3).uniform(-0.2, 0.2, (60, 2))
    is_ice = shapely.contains_xy(ice, *xy.T)
    for k, name in enumerate(("a.tif", "b.tif")):
        places = xy - np.where(is_ice, 6.0 * k, 0.0)[:, None] * [1.0, 0.0]
        heights = np.cos(places @ waves.T + 7.0 * waves[:, 0]).sum(axis=1) / 10.0 - MELT_M * k * is_ice
        rough = heights + np.random.default_rng(k).normal(0.0, 0.01, len(xy))
        Dem.on(grid, rough.reshape(grid.shape)).write(tmp_path / name)
    inner, names = ice.buffer(-25.0), {"name": np.array(["ice"], dtype=object)}
    write_features(tmp_path / "ice.gpkg", [inner], names, grid.crs, layer="ice")
    write_features(
        tmp_path / "rock.gpkg", [shapely.box(200.0, 0.0, 300.0, 300.0)], names, grid.crs, layer="rock"
    )
    for name, value in {"east": 1.5, "north": 0.0, "sigma": 0.01}.items():
        Dem.on(grid, np.full(grid.shape, value)).write(tmp_path / f"{name}.tif")
    motion = uniform_motion((1.5, 0.0), 0.2, velocity_sigma=0.01, lowering_sigma=0.01, epoch_s=0.0)
    write_motion(motion, tmp_path / "ice_motion.json")
    monkeypatch.chdir(tmp_path)


COMMAND = ["change", "b.tif", "a.tif", "--outline", "ice.gpkg", "--stable", "rock.gpkg", "--json"]


def balance_of(*options: str) -> dict[str, float]:
    done = CliRunner().invoke(app, [*COMMAND, *options])
    assert done.exit_code == 0, done.output
    assert Path("change/along_flow.tif").exists()
    (balance,) = json.loads(done.stdout)["along_flow"]
    return balance


@pytest.mark.usefixtures("pair")
@pytest.mark.parametrize(
    "flow",
    [["ice_motion.json", "--days", "4"], ["east.tif,north.tif,sigma.tif,sigma.tif", "--days", "4"]],
)
def test_velocities_and_days_give_the_melt_along_the_flow(flow: list[str]) -> None:
    balance = balance_of("--flow", *flow, "--thickness", "50")
    assert balance["along_mean_m"] == pytest.approx(-MELT_M, abs=0.05)
    assert balance["thickness_m"] == 50.0
    assert abs(balance["flux_divergence_m"]) < 1e-9


@pytest.mark.usefixtures("pair")
def test_a_file_of_tracked_displacements_gives_the_melt_along_the_flow() -> None:
    tracked = CliRunner().invoke(
        app,
        [
            "track",
            "a.tif",
            "b.tif",
            "--days",
            "4",
            "--window",
            "15",
            "--step",
            "8",
            "--search",
            "4",
            "-o",
            "v.gpkg",
        ],
    )
    assert tracked.exit_code == 0, tracked.output
    balance = balance_of("--flow", "v.gpkg")
    assert abs(balance["along_mean_m"] + MELT_M) < 3.0 * balance["along_std_m"]


@pytest.mark.usefixtures("pair")
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--flow", "ice_motion.json"], "add --days"),
        (["--flow", "east.tif,north.tif", "--days", "4"], "name four with commas"),
        (["--days", "4"], "belongs to --flow"),
        (["--flow", "ice_motion.json", "--days", "4", "--thickness", "-3"], "positive number"),
        (["--flow", "ice_motion.json", "--days", "4", "--thickness", "inf"], "positive number"),
        (["--flow", "ice_motion.json", "--days", "4000"], "carries all ice beyond the later survey"),
        (["--flow", "track", "--days", "4"], "leave --days out"),
        (["--flow", "ice.gpkg"], "has no column east_m"),
    ],
)
def test_an_incomplete_flow_is_refused_and_nothing_is_written(options: list[str], said: str) -> None:
    done = CliRunner().invoke(app, [*COMMAND, *options])
    assert done.exit_code in (3, 4)
    assert said in " ".join(done.output.split())
    assert not Path("change").exists()
