"""Glaciers of an inventory by their names and heights, at every command that reads an outline."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid, Route, SurfacePoints
from survey.io.vector import write_features

UTM = CRS("EPSG:32608")
WEST, SOUTH = 526_000.0, 6_478_000.0
ONE = "RGIId=RGI60-01.00001"


@pytest.fixture(autouse=True)
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    grid = Grid((WEST - 100.0, SOUTH - 100.0, WEST + 1100.0, SOUTH + 500.0), 20.0, UTM)
    x, y = np.meshgrid(grid.x - WEST, grid.y - SOUTH)
    heights = 2700.0 + 0.25 * y + 0.5 * np.sin(x / 60.0)  # 0.25 m for each metre to the north
    Dem.on(grid, heights).write("prior.tif")
    Dem.on(grid, heights + 0.2).write("later.tif")
    shapes = [shapely.box(WEST + x, SOUTH, WEST + x + 400.0, SOUTH + 400.0) for x in (0.0, 600.0)]
    columns = {"RGIId": ["RGI60-01.00001", "RGI60-01.00002"], "Name": ["Gulkana", "Wolverine"]}
    attributes = {name: np.array(values, dtype=object) for name, values in columns.items()}
    write_features("rgi.gpkg", shapes, attributes, UTM, layer="rgi")
    xy = np.column_stack([WEST + x.ravel(), SOUTH + y.ravel()])
    SurfacePoints(np.column_stack([xy, heights.ravel()]), sigma_m=0.1, crs=UTM).write("points.gpkg")


def run(*args: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, [*args])
    assert result.exit_code == code, result.output
    return result.output


SEASON = ("--season", "0.5", "--dates", "2026-05-01,2026-09-20", "--surface", "snow")
# A kernel that is given: what is chosen is the glacier.
KNOWN = ("fit=false", "variance_m2=100.0", "length_scale_m=100.0")
GIVEN = [word for setting in KNOWN for word in ("--set", f"reconstruction.gp.{setting}")]
DOORS = {
    "plan": ("plan", "rgi.gpkg", "--prior", "prior.tif", "-o", "out.geojson"),
    "guarantee": ("plan", "rgi.gpkg", "--prior", "prior.tif", "--require", "1.0", "-o", "out.geojson"),
    "season": ("plan", "rgi.gpkg", "--prior", "prior.tif", *SEASON, "-o", "out.geojson"),
    "reconstruct": (
        "reconstruct", "points.gpkg", "--prior", "prior.tif", "--grid", "20", "--area", "rgi.gpkg", "-o", "out", *GIVEN,
    ),
    "score": ("score", "later.tif", "--truth", "prior.tif", "--area", "rgi.gpkg"),
    "export": ("export", "rgi.gpkg", "out.kml"),
}  # fmt: skip


@pytest.mark.parametrize("door", DOORS)
def test_every_door_asks_for_a_choice_and_takes_one(door: str) -> None:
    said = run(*DOORS[door], code=3)
    assert (
        "holds 2 glaciers (RGIId=RGI60-01.00001 (Gulkana), RGIId=RGI60-01.00002 (Wolverine)); choose" in said
    )
    assert not [*Path().glob("out*")]
    run(*DOORS[door], "--select", ONE)


def test_outlines_of_a_change_are_chosen() -> None:
    every = run("change", "later.tif", "prior.tif", "--outline", "rgi.gpkg", "-o", "both")
    assert "Gulkana" in every
    assert "Wolverine" in every
    one = run("change", "later.tif", "prior.tif", "--outline", "rgi.gpkg", "--select", "gulk*", "-o", "one")
    assert "Wolverine" not in one


def test_the_tongue_is_planned_and_mapped_below_a_height() -> None:
    run(*DOORS["plan"], "--select", "Gulkana", "--below", "2750")
    route = Route.read("out.geojson")
    places = np.vstack([leg.xy for leg in route.legs])
    assert places[:, 0].max() <= WEST + 400.0
    assert SOUTH + 150.0 < places[:, 1].max() <= SOUTH + 200.0
    run(*DOORS["reconstruct"], "--select", ONE, "--above", "2725", "--below", "2750")
    bounds = Dem.read("out/dem.tif").bounds
    assert bounds[1] > SOUTH + 60.0
    assert bounds[3] < SOUTH + 230.0


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("plan", "rgi.gpkg", "--select", ONE, "--below", "2750"), "add --prior with its raster"),
        ((*DOORS["plan"], "--select", ONE, "--below", "100"), "change --above or --below"),
        ((*DOORS["plan"], "--select", "Hubbard"), "has no outline 'Hubbard'; it holds RGIId"),
        (("reconstruct", "points.gpkg", "--select", ONE, "-o", "out"), "add --area with its file"),
        (("score", "later.tif", "--truth", "prior.tif", "--select", ONE), "add --area with its file"),
    ],
)
def test_a_choice_that_cannot_be_made_is_refused(args: tuple[str, ...], words: str) -> None:
    assert words in run(*args, code=3)
