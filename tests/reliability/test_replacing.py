"""Every command that replaces its output is killed at random: what is there afterwards is the old output or the new."""

import hashlib
import os
import random
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from survey import Dem, Grid, SurfacePoints, SurveyArea
from tests.reliability.test_same_bytes import MISSION, Nursery

pytestmark = [pytest.mark.reliability, pytest.mark.slow, pytest.mark.timeout(3600)]

CRS = "EPSG:32608"
N_KILLS = int(os.environ.get("FIRNLINE_REPLACE_KILLS", "2"))
STUDY = """
schema_version = 1
name = "small"
trials = 20
swaths = [2]
map_step_m = 25.0
[[terrains]]
source = "random"
name = "smooth"
family = "squared-exponential"
size_m = 200.0
length_scale_m = 80.0
[[planners]]
pattern = "lawnmower"
"""
# Command, its first and second variant (which give different output), and its outputs.
COMMANDS = {
    "init": ("init mine.toml --force", "", "--dem dem.tif", ["mine.toml"]),
    "plan": (
        "plan area.gpkg -o route.geojson --force -q",
        "--swaths 3",
        "--swaths 4",
        ["route.geojson", "route.png"],
    ),
    "reconstruct": (
        "reconstruct points.csv --crs EPSG:32608 --method tin -o map --force -q",
        "--grid 5",
        "--grid 4",
        ["map"],
    ),
    "localize": (
        "localize recording -o localized --force -q",
        "",
        "--set localization.gps_white_sigma_m=2.0",
        ["localized"],
    ),
    "change": (
        "change dem.tif older.tif --outline outline.gpkg -o change --force",
        "--density 850",
        "--density 900",
        ["change"],
    ),
    "export": ("export dem.tif dem.asc --force", "", "", ["dem.asc", "dem.prj"]),
    "reproduce": (
        "reproduce glacier-tables -o studies --force -q",
        "--quick",
        "",
        ["studies/glacier-tables"],
    ),
    "run": (
        "run m.toml --runs runs -q --until plan --fresh",
        "",
        "",
        ["runs/small/latest/1-plan"],
    ),
    "montecarlo": (
        "montecarlo s.toml --runs montecarlo -q --engine serial --fresh",
        "",
        "",
        [
            f"montecarlo/small/{name}"
            for name in ("trials.parquet", "trials.csv", "summary.csv", "index.html")
        ],
    ),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with an input for every command."""
    folder = tmp_path_factory.mktemp("replacing")
    rng = np.random.default_rng(1)
    grid = Grid((0.0, 0.0, 150.0, 150.0), 5.0, CRS)
    dem = Dem.on(grid, 100.0 + np.cumsum(rng.normal(size=grid.shape), axis=0))
    dem.write(folder / "dem.tif")
    Dem.on(grid, dem.elevation - rng.random(grid.shape)).write(folder / "older.tif")
    SurveyArea.rectangle((0.0, 0.0, 150.0, 150.0), CRS).write(folder / "area.gpkg")
    SurveyArea.rectangle((40.0, 40.0, 100.0, 100.0), CRS).write(folder / "outline.gpkg")
    SurfacePoints(np.column_stack([grid.xy, dem.at(grid.xy)])[::7], sigma_m=0.1, crs=CRS).write(
        folder / "points.csv"
    )
    (folder / "m.toml").write_text(MISSION)
    (folder / "s.toml").write_text(STUDY)
    return folder


@pytest.fixture(scope="module")
def commands(place):
    before = Path.cwd()
    os.environ["PYTHONPATH"] = os.environ.get("PYTHONPATH", str(before))
    os.chdir(place)
    nursery = Nursery(place / "m.toml")
    assert done(nursery, "run m.toml --runs first -q --until simulate") == 0
    shutil.copytree("first/small/latest/2-simulate/recording", "recording")
    yield nursery
    nursery.process.stdin.close()
    nursery.process.wait()
    nursery.process.stdout.close()
    os.chdir(before)


def started(nursery: Nursery, command: str) -> int:
    nursery.process.stdin.write("\t".join(command.split()) + "\n")
    nursery.process.stdin.flush()
    return nursery._number()


def done(nursery: Nursery, command: str) -> int | None:
    started(nursery, command)
    return nursery.ended(within_s=300.0)


def state(outputs: list[str]) -> dict[str, str]:
    """Digest of every output file; hidden drafts are no output."""
    files = [file for name in outputs for file in [Path(name), *Path(name).rglob("*")] if file.is_file()]
    return {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(files)}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_killed_while_it_replaces_leaves_the_old_output_or_the_new(commands, name):
    command, first, second, outputs = COMMANDS[name]
    assert done(commands, f"{command} {first}") == 0
    old = state(outputs)
    began = time.monotonic()
    assert done(commands, f"{command} {second}") == 0
    seconds = time.monotonic() - began
    new = state(outputs)
    assert old.keys() == new.keys() or name in ("localize", "reproduce")
    moments = random.Random(name)
    for _ in range(N_KILLS):
        assert done(commands, f"{command} {first}") == 0
        assert state(outputs) == old
        process = started(commands, f"{command} {second}")
        if commands.ended(within_s=moments.uniform(0.0, 1.1) * seconds) is None:
            os.kill(process, 9)
            commands.ended(within_s=60.0)
        assert state(outputs) in (old, new)
