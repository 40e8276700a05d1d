"""Each command imports what it uses: the packages that it must not load, and how many modules it may."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firnline import actions
from firnline.actions.plan_request import PlanRequest
from survey import Dem, Grid, InputError, SurveyArea

CRS = "EPSG:32608"
# The modules of a run are printed last; a command ends by an exception.
PROGRAM = """
import json, sys
from firnline.__main__ import main
sys.argv = ["firnline", *sys.argv[1:]]
try:
    main()
except SystemExit as ending:
    code = ending.code
print(json.dumps([code, sorted(sys.modules)]))
"""
FRAMES = {"pandas", "geopandas"}
DRAWING = {"matplotlib", "PIL"}
COMPILED = {"numba", "cv2", "mujoco", "pybullet", "skimage", "sklearn"}
ENGINES = {"finufft", "scipy.optimize", "scipy.interpolate", "scipy.signal"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two maps, checkpoints and an outline."""
    folder = tmp_path_factory.mktemp("imports")
    grid = Grid.over((500_000.0, 6_700_000.0, 500_200.0, 6_700_200.0), 4.0, CRS)
    height = 900.0 + 5.0 * np.sin(grid.xy[:, 0] / 30.0).reshape(grid.shape)
    for name, change_m in (("earlier", 0.0), ("later", 0.25)):
        Dem.on(grid, height + change_m).write(folder / f"{name}.tif")
    places = grid.xy[:: len(grid.xy) // 40]
    rows = [f"P{k},{x},{y},900.0,0.02" for k, (x, y) in enumerate(places)]
    (folder / "points.csv").write_text("\n".join(["name,x,y,z,sigma_z", *rows, ""]))
    SurveyArea.rectangle((500_050.0, 6_700_050.0, 500_120.0, 6_700_120.0), CRS).write(folder / "area.geojson")
    return folder


CASES = {
    "score": ("score later.tif --checkpoints points.csv", 0, 950, FRAMES | DRAWING | COMPILED | ENGINES | {"pyogrio"}),
    "score by a raster": ("score later.tif --truth earlier.tif", 0, 850, FRAMES | DRAWING | COMPILED | ENGINES),
    "change": ("change later.tif earlier.tif --outline area.geojson -o change", 0, 1350, FRAMES | COMPILED | {"finufft"}),
    "plan": ("plan area.geojson --swaths 4 -o plan.geojson", 0, 1650, FRAMES | COMPILED - {"numba"} | {"finufft"}),
    "change without pictures": (
        "change later.tif earlier.tif --outline area.geojson --no-pictures -o bare/change", 0, 1100, FRAMES | COMPILED | DRAWING,
    ),
    "plan without pictures": ("plan area.geojson --swaths 4 --no-pictures -o bare/plan.geojson", 0, 1350, FRAMES | DRAWING),
    "map without pictures": (
        "reconstruct points.csv --crs EPSG:32608 --method tin --grid 5 --no-pictures -o bare/map", 0, 1350, FRAMES | DRAWING,
    ),
    "no checkpoints": ("score later.tif --checkpoints none.csv", 3, 400, FRAMES | DRAWING | COMPILED | ENGINES | {"numpy"}),
    "no area": ("plan none.gpkg --swaths 4", 3, 400, FRAMES | DRAWING | COMPILED | ENGINES | {"numpy"}),
    "no points": ("reconstruct none.csv --crs EPSG:32608", 3, 400, FRAMES | DRAWING | COMPILED | ENGINES | {"numpy"}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_command_loads_what_it_uses(case: str, place: Path) -> None:
    command, code, most, needless = CASES[case]
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, *command.split()],
        cwd=place,
        capture_output=True,
        text=True,
        check=False,
    )
    ended, modules = json.loads(run.stdout.splitlines()[-1])
    assert (ended or 0) == code, run.stderr
    assert not needless.intersection(modules)
    assert not list((place / "bare").rglob("*.png"))
    assert len(modules) <= most


def test_pictures_are_left_out(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    plan = PlanRequest(source=Path("area.geojson"), swaths=4, out=Path("drawn/plan.geojson"))
    Path("drawn").mkdir()
    actions.plan(plan).write()
    assert sorted(file.name for file in Path("drawn").iterdir()) == ["plan.geojson", "plan.png"]
    # The picture of a plan that is replaced would be of another route.
    assert (
        "drawn/plan.png" not in actions.plan(replace(plan, no_pictures=True, force=True)).write().lines()[0]
    )
    assert sorted(file.name for file in Path("drawn").iterdir()) == ["plan.geojson"]
    with pytest.raises(InputError, match="are pictures; leave --no-pictures out"):
        actions.plan(replace(plan, no_pictures=True, out=Path("drawn/plan.pdf")))
