"""``firnline overhangs``: mesh, facts and picture of a face that leans over the ground, scans of a drive, and refusals."""

import json
from pathlib import Path

import numpy as np
import plyfile
import pytest
from typer.testing import CliRunner

from firnline import actions
from firnline.cli.main import app
from survey import SurfacePoints, SurveyArea
from tests.docs.scratch import CRS, SOUTH, WEST, write_serac
from tests.vision_slam.tilted_plane import height, write_drive

FACE_M2 = 4.0 * np.hypot(3.0, 1.5)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("overhangs")
    write_serac(folder / "serac.ply")
    points = SurfacePoints.read(folder / "serac.ply")
    SurfacePoints(points.xyz, sigma_m=0.01, crs=CRS).write(folder / "placeless.ply")
    np.savez(folder / "one.npz", points=points.xyz, origin=[WEST - 6.0, SOUTH + 2.0, 801.5])
    wide = points.xyz * [300.0, 300.0, 1.0] - 299.0 * np.array([WEST, SOUTH, 0.0])
    np.savez(folder / "wide.npz", points=wide, origin=[WEST - 6.0, SOUTH + 2.0, 801.5])
    write_drive(folder)
    return folder


def said(place: Path, words: str) -> str:
    done = CliRunner().invoke(app, ["overhangs", *(word.format(place=place) for word in words.split())])
    return " ".join(done.output.split())


def test_the_leaning_face_is_found_with_its_area_and_steepness(place):
    printed = said(place, "{place}/serac.ply --no-pictures -o {place}/serac")
    out = place / "serac"
    assert {file.name for file in out.iterdir()} == {"surface.ply", "overhangs.json"}, printed
    facts = json.loads((out / "overhangs.json").read_text())
    assert facts["n_places"] == 2
    assert facts["overhanging_m2"] == pytest.approx(FACE_M2, rel=0.1)
    assert facts["sections"][0]["steepness_deg"] == pytest.approx(116.6, abs=4.0)
    vertices = plyfile.PlyData.read(out / "surface.ply")["vertex"]
    x, z = vertices["x"] - WEST, vertices["z"] - 800.0
    on_face = (z > 0.5) & (z < 2.5) & (vertices["supported"] == 1)
    error = (x + 0.5 * z)[on_face] * np.cos(np.arctan(0.5))
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.mean(np.abs(error) <= 1.96 * vertices["sigma"][on_face]) > 0.9
    assert "exists; choose another name or add --force" in said(place, "{place}/serac.ply -o {place}/serac")


def test_one_scan_does_not_show_the_error_of_its_place(place):
    request = actions.OverhangsRequest(
        sources=[place / "one.npz"], crs=CRS, sigma_m=0.01, step_m=0.4, out=place / "one"
    )
    alone = actions.overhangs(request)
    assert "--scan-sigma" in alone.notes[0]
    stated = actions.overhangs(
        actions.OverhangsRequest(
            sources=[place / "one.npz"],
            crs=CRS,
            sigma_m=0.01,
            scan_sigma_m=0.1,
            step_m=0.4,
            out=place / "one",
        )
    )
    assert not stated.notes
    seen = stated.surface.is_supported
    assert np.median(alone.surface.sigma_m[seen]) < 0.03
    assert stated.surface.sigma_m[seen].min() >= 0.1


def test_every_return_of_a_drive_is_used_with_the_error_of_its_path(place):
    SurveyArea.rectangle((WEST + 1.0, SOUTH - 6.0, WEST + 9.0, SOUTH + 6.0), CRS).write(
        place / "area.geojson"
    )
    made = actions.overhangs(
        actions.OverhangsRequest(
            sources=[place / "drive"],
            trajectory=place / "localized" / "trajectory.csv",
            crs=CRS,
            area=place / "area.geojson",
            step_m=0.5,
            out=place / "plane",
        )
    )
    returns = made.returns
    assert len(returns) > 1000
    assert (returns.covariance[:, 2, 2] > returns.own_covariance[:, 2, 2]).all()
    assert returns.xyz[:, 0].min() >= WEST + 1.0
    seen = made.surface.nodes[made.surface.is_supported]
    assert np.median(np.abs(height(seen[:, :2]) - seen[:, 2])) < 0.03
    assert made.sections == []
    assert "sections: none" in " ".join(made.lines())


def test_points_with_times_are_seen_from_the_path_of_the_scanner(place):
    points = SurfacePoints.read(place / "serac.ply")
    time_s = np.linspace(10.0, 11.0, len(points))
    SurfacePoints(points.xyz, sigma_m=0.01, values={"time_s": time_s}, crs=CRS).write(place / "timed.ply")
    poses = [f"{t} {WEST - 6.0} {SOUTH + north} 801.5 0 0 0 1" for t, north in ((10.0, 1.0), (11.0, 3.0))]
    (place / "path.tum").write_text("\n".join(poses) + "\n")
    request = actions.OverhangsRequest(
        sources=[place / "timed.ply"], trajectory=place / "path.tum", step_m=0.4, out=place / "timed"
    )
    made = actions.overhangs(request)
    assert made.returns.origins[0] == pytest.approx([WEST - 6.0, SOUTH + 1.0, 801.5])
    assert made.returns.origins[-1] == pytest.approx([WEST - 6.0, SOUTH + 3.0, 801.5])
    assert made.facts()["overhanging_m2"] == pytest.approx(FACE_M2, rel=0.15)


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        ("{place}/placeless.ply", "add the columns origin_x_m, origin_y_m and origin_z_m"),
        ("{place}/one.npz --crs EPSG:32608", "give one with --sigma"),
        ("{place}/one.npz --sigma 0.01", "give it with --crs"),
        ("{place}/wide.npz --crs EPSG:32608 --sigma 0.01", "with --area, or choose a larger --grid"),
        ("{place}/serac.ply --trajectory {place}/localized/trajectory.csv", "leave --trajectory out"),
        ("{place}/drive", "with --trajectory trajectory.csv"),
        ("{place}/drive {place}/serac.ply", "name it alone"),
        ("{place}/drive --trajectory {place}/localized/trajectory.csv", "give it with --crs"),
    ],
)  # fmt: skip
def test_a_refusal_names_the_remedy(place, words, remedy):
    assert remedy in said(place, f"{words} -o {{place}}/none --dry-run")
    assert not (place / "none").exists()


def test_an_area_without_returns_is_refused(place):
    SurveyArea.rectangle((WEST + 90.0, SOUTH, WEST + 99.0, SOUTH + 9.0), CRS).write(place / "far.geojson")
    assert "check --area" in said(place, "{place}/serac.ply --area {place}/far.geojson -o {place}/none")


@pytest.mark.pictures
def test_the_picture_stands_beside_mesh_and_facts(place):
    printed = said(place, "{place}/serac.ply --grid 0.5 -o {place}/drawn")
    names = {file.name for file in (place / "drawn").iterdir()}
    assert names == {"surface.ply", "overhangs.json", "overhangs.png"}, printed
