"""``firnline reroute``: the changed route, its facts and its picture, and refusals."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Leg, Route

EAST, NORTH = 500_000.0, 6_700_000.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A swath across a ditch, and points of the ground around it."""
    folder, rng = tmp_path_factory.mktemp("reroute"), np.random.default_rng(3)
    xy = rng.uniform((-5.0, -15.0), (28.0, 15.0), (90_000, 2))
    z = 0.02 * xy[:, 0] + 0.02 * rng.standard_normal(len(xy))
    z[(np.abs(xy[:, 0] - 12.0) < 0.4) & (xy[:, 1] < 4.0)] -= 2.0
    table = np.column_stack([xy + [EAST, NORTH], 100.0 + z])
    np.savetxt(folder / "scans.csv", table, delimiter=",", header="x_m,y_m,z_m", comments="", fmt="%.3f")
    line = Leg("swath", [[EAST, NORTH], [EAST + 25.0, NORTH]])
    Route((line,), "EPSG:32608", "line").write(folder / "route.geojson")
    return folder


def run(site: Path, out: Path, *options: str, code: int = 0) -> str:
    command = ["reroute", str(site / "route.geojson"), str(site / "scans.csv"), "-o", str(out), *options]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == code, result.output
    return result.output


@pytest.mark.pictures
def test_the_route_goes_around_the_ditch(site: Path, tmp_path: Path) -> None:
    said = run(site, tmp_path / "new")
    names = {file.name for file in (tmp_path / "new").iterdir()}
    assert names == {"route.geojson", "probability.tif", "reroute.json", "reroute.png"}
    route = Route.read(tmp_path / "new" / "route.geojson")
    path = route.path() - [EAST, NORTH]
    north = np.interp(12.0, path[:, 0], path[:, 1])
    assert north > 4.5
    assert path[-1] == pytest.approx([25.0, 0.0])
    facts = json.loads((tmp_path / "new" / "reroute.json").read_text())
    assert facts["n_detours"] == 1
    assert facts["length_m"] == pytest.approx(route.length_m)
    assert "1 detours" in said
    assert facts["seen_share_of_route"] > 0.95
    probability = Dem.read(tmp_path / "new" / "probability.tif")
    assert probability.at(np.array([[EAST + 12.0, NORTH - 5.0], [EAST + 5.0, NORTH]])) == pytest.approx(
        [1.0, 0.0], abs=0.05
    )


def test_a_gentle_limit_leaves_the_route(site: Path, tmp_path: Path) -> None:
    said = run(site, tmp_path / "same", "--max-slope", "80", "--at", f"{EAST + 16},{NORTH}", "--no-pictures")
    assert "nothing is in the way" in said
    assert Route.read(tmp_path / "same" / "route.geojson").length_m == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--at", "here"), 4, "--at 'here' is no place"),
        (("--at", "510000,6700000"), 3, "none of 90000 points is within 30 m"),
        (("--crs", "EPSG:32609"), 3, "give both in one CRS"),
        (("--max-slope", "0.5"), 3, "too uncertain for a limit of 0.5°"),
    ],
)
def test_what_cannot_be_used_is_refused(
    site: Path, tmp_path: Path, options: tuple[str, ...], code: int, words: str
) -> None:
    assert words in " ".join(run(site, tmp_path / "none", *options, code=code).split())
    assert not (tmp_path / "none").exists()


def test_a_result_is_replaced_with_force_only(site: Path, tmp_path: Path) -> None:
    run(site, tmp_path / "new", "--no-pictures")
    run(site, tmp_path / "new", "--no-pictures", code=3)
    run(site, tmp_path / "new", "--no-pictures", "--force")
