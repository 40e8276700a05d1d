"""The reconstruct command: settings, area, the joint map of one's own data, priors that end, outputs."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy import sparse
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.path_error import PathError
from survey.data.sensors.odometry import DriveTies
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.terrain_map import Reconstruction

CRS = "EPSG:32608"
KNOWN = ["fit=false", "variance_m2=4.0", "length_scale_m=20.0"]
GP = [word for setting in KNOWN for word in ("--set", f"reconstruction.gp.{setting}")]


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["reconstruct", *map(str, arguments)])
    return result.exit_code, result.output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Points over 40 × 40 m, seen from a path of two keyframes, and the path with its error."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    n = 120
    keyframe = rng.uniform(0.0, 1.0, n)
    xyz = np.column_stack([rng.uniform(0.0, 40.0, (n, 2)), rng.normal(0.0, 0.05, n)])
    body = np.column_stack([40.0 * keyframe, np.full(n, 20.0), np.zeros(n)])
    own = np.tile(np.diag([1e-6, 1e-6, 0.0025]), (n, 1, 1))
    seen = {"own_covariance": own, "keyframe": keyframe, "heading_rad": np.zeros(n), "body": body}
    points = SurfacePoints(
        xyz, covariance=own + 0.01 * np.eye(3), origins=body + [0, 0, 0.7], crs=CRS, **seen
    )
    points.write("points.gpkg")
    ends = np.array([[0.0, 20.0, 0.0], [40.0, 20.0, 0.0]])
    error = PathError(np.array([0.0, 9.0]), sparse.identity(12, format="csr") * 100.0, 6)
    level = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    Trajectory(error.time_s, ends, level, np.zeros((2, 3, 3)), CRS, error=error).write("trajectory.csv")
    return tmp_path


def test_settings_reach_every_method_as_in_a_mission(folder: Path) -> None:
    code, said = run("points.gpkg", "--grid", 4, *GP, "--json")
    assert code == 0, said
    assert json.loads(said)["hyperparameters"]["length_scale_m"] == pytest.approx(20.0)
    stiffness = ("--set", "reconstruction.field.stiffness=77.0")
    code, said = run("points.gpkg", "--method", "field", "--grid", 4, *stiffness, "--force", "--json")
    assert code == 0, said
    assert json.loads(said)["hyperparameters"]["stiffness"] == 77.0


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("reconstruction.gp.familyy=auto", "did you mean family"),
        ("planner.swaths=6", "planner is not known"),
        ("reconstruction.method=kriging", "gp, joint, dense"),
        ("reconstruction.grid_step_m=-1.0", "greater than 0"),
    ],
)
def test_wrong_settings_end_with_4(folder: Path, setting: str, said: str) -> None:
    code, output = run("points.gpkg", "--set", setting)
    assert code == 4
    assert said in output


def test_an_area_is_mapped_instead_of_the_bounding_box(folder: Path) -> None:
    SurveyArea.rectangle((-8.0, 0.0, 48.0, 40.0), CRS).write("site.gpkg")
    code, said = run("points.gpkg", "--grid", 4, "--area", "site.gpkg", *GP)
    assert code == 0, said
    assert "  area               site.gpkg" in said
    assert Dem.read("reconstruction/dem.tif").grid().bounds == (-8.0, 0.0, 48.0, 40.0)
    code, said = run("points.gpkg", "--grid", 4, *GP, "--force")
    assert "  area               bounding box of the points" in said


def test_an_area_far_from_the_points_is_refused(folder: Path) -> None:
    SurveyArea.rectangle((9000.0, 0.0, 9040.0, 40.0), CRS).write("site.gpkg")
    for method in ("gp", "field", "tin"):
        code, said = run("points.gpkg", "--grid", 4, "--area", "site.gpkg", "--method", method)
        assert code == 3, said


def test_the_joint_map_of_own_data_corrects_the_path(folder: Path) -> None:
    code, said = run("points.gpkg", "--method", "joint", "--trajectory", "trajectory.csv", "--grid", 4, *GP)
    assert code == 0, said
    assert Trajectory.read("reconstruction/corrected_trajectory.csv", CRS).error is None
    assert Reconstruction.read("reconstruction").hyperparameters["landmark_errors"] == "joint"


def test_the_drives_of_two_rovers_are_mapped_together(folder: Path) -> None:
    drives = ("points.gpkg", "points.gpkg", "--method", "joint", "--trajectory", "trajectory.csv")
    code, said = run(*drives, "--trajectory", "trajectory.csv", "--grid", 4, *GP, "--json")
    assert code == 0, said
    assert json.loads(said)["diagnostics"]["n_points"] == 240
    for k in (1, 2):
        assert Trajectory.read(f"reconstruction/corrected_trajectory_{k}.csv", CRS).error is None
    code, said = run(*drives, "--grid", 4, *GP, "--force")
    assert (code, "2 sources of points and 1 trajectories" in said) == (3, True)


def test_ties_move_the_path_of_one_drive_onto_the_other(folder: Path) -> None:
    path = Trajectory.read("trajectory.csv", CRS)
    off = np.array([0.06, 0.0, 0.0])
    moment, offset = path.time_s[:1], (path.position[1] - path.position[0] - off)[None]
    DriveTies(moment, [0], [1], path.time_s[1:], offset, [1e-8 * np.eye(3)]).write("ties.csv")
    drives = ("points.gpkg", "points.gpkg", "--method", "joint", "--trajectory", "trajectory.csv")
    drives += ("--trajectory", "trajectory.csv", "--grid", 4, *GP)
    easting = {}
    for name, more in (("apart", ()), ("tied", ("--ties", "ties.csv"))):
        code, said = run(*drives, *more, "-o", name)
        assert code == 0, said
        parts = [Trajectory.read(f"{name}/corrected_trajectory_{k}.csv", CRS) for k in (1, 2)]
        easting[name] = [parts[0].position[0, 0], parts[1].position[1, 0]]
    assert np.ptp(easting["apart"]) == pytest.approx(40.0, abs=0.02)
    assert np.ptp(easting["tied"]) == pytest.approx(40.0 - off[0], abs=0.005)


def test_ties_of_one_drive_are_refused(folder: Path) -> None:
    drive = ("points.gpkg", "--method", "joint", "--trajectory", "trajectory.csv")
    code, said = run(*drive, "--ties", "ties.csv")
    assert (code, "there are not two" in said) == (3, True)


def test_the_joint_map_names_what_is_missing(folder: Path) -> None:
    code, said = run("points.gpkg", "--method", "joint")
    assert (code, "add --trajectory trajectory.csv" in said) == (3, True)
    Path("trajectory.error.npz").unlink()
    code, said = run("points.gpkg", "--method", "joint", "--trajectory", "trajectory.csv")
    assert (code, "trajectory.error.npz was expected" in said) == (3, True)
    code, said = run("points.gpkg", "--method", "gp", "--trajectory", "trajectory.csv")
    assert (code, "take --method joint" in said) == (3, True)


def test_the_share_that_a_prior_covers_is_printed_and_none_is_refused(folder: Path) -> None:
    def prior(west_m: float) -> str:
        Dem.on(Grid((west_m, -10.0, west_m + 30.0, 50.0), 10.0, CRS), np.zeros((7, 4))).write("prior.tif")
        return "prior.tif"

    code, said = run("points.gpkg", "--grid", 4, "--prior", prior(-10.0), *GP)
    assert code == 0, said
    assert "  prior              covers 6" in said
    mean = Dem.read("reconstruction/dem.tif").elevation
    assert np.isfinite(mean[:, 0]).all()
    assert np.isnan(mean[:, -1]).all()
    code, said = run("points.gpkg", "--grid", 4, "--prior", prior(9000.0), *GP, "--force")
    assert code == 3
    assert "none of the 120 points lies on the prior" in said


@pytest.mark.pictures
def test_companions_of_an_earlier_map_disappear_and_files_of_others_stay(folder: Path) -> None:
    code, said = run("points.gpkg", "--grid", 4, "--rays", *GP)
    assert code == 0, said
    assert Path("reconstruction/bounds.tif").exists()
    Path("reconstruction/no_go.tif").write_bytes(b"old")
    code, said = run("points.gpkg", "--grid", 4, *GP, "--force")
    assert code == 0, said
    assert sorted(file.name for file in Path("reconstruction").iterdir()) == [
        *("dem.tif", "mean.png", "reconstruction.json", "sigma.png", "support.png"),
        *("support.tif", "support.tif.aux.xml"),
    ]
    Path("reconstruction/notes.txt").write_text("mine")
    code, said = run("points.gpkg", "--grid", 4, *GP, "--force")
    assert (code, "notes.txt" in said) == (3, True)
    assert Path("reconstruction/notes.txt").read_text() == "mine"


def test_a_refused_map_leaves_the_old_one(folder: Path) -> None:
    assert run("points.gpkg", "--grid", 4, *GP)[0] == 0
    before = Path("reconstruction/dem.tif").read_bytes()
    assert run("points.gpkg", "--method", "tin", "--grid", 1e-7, "--force")[0] == 3
    assert run("points.gpkg", "--grid", 4)[0] == 3
    assert Path("reconstruction/dem.tif").read_bytes() == before


@pytest.mark.parametrize("method", ["gp", "dense", "tin", "field", "emap"])
@pytest.mark.parametrize("step_m", ["0.001", "1e-300"])
def test_grids_beyond_memory_are_refused_with_the_step_that_passes(
    folder: Path, method: str, step_m: str
) -> None:
    code, said = run("points.gpkg", "--method", method, "--grid", step_m)
    assert code == 3, said
    assert "MB allowed" in said
    assert "or more" in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--method", "tin", "--prior", "prior.tif"), "uses no prior"),
        (("--method", "emap", "--rays"), "uses no lines of sight"),
        (("--method", "field", "--value", "temperature_c"), "maps elevations"),
    ],
)
def test_options_that_a_method_does_not_use_are_refused(
    folder: Path, arguments: tuple[str, ...], said: str
) -> None:
    (folder / "prior.tif").touch()
    code, output = run("points.gpkg", *arguments)
    assert code == 3
    assert said in output


def test_a_prior_in_conflict_with_the_points_is_reported_in_one_sentence(folder: Path) -> None:
    cells = Grid((-10.0, -10.0, 50.0, 50.0), 5.0, CRS)
    Dem.on(cells, np.full(cells.shape, 40.0)).write("prior.tif")
    matern = ("--set", "reconstruction.gp.family=matern-3/2")
    code, said = run("points.gpkg", "--prior", "prior.tif", "--product", "srtm-90", "--grid", 4, *matern)
    assert code == 0, said
    assert "  prior              lies +40." in said
    assert "  warning            the prior lies 40." in said


def test_a_class_of_products_must_be_known_and_needs_a_prior(folder: Path) -> None:
    (folder / "prior.tif").touch()
    code, said = run("points.gpkg", "--product", "srtm-90")
    assert (code, "add --prior" in said) == (3, True)
    code, said = run("points.gpkg", "--prior", "prior.tif", "--product", "srtm")
    assert (code, "copernicus-30" in said) == (4, True)


@pytest.mark.pictures
def test_every_map_has_pictures_and_a_next_step(folder: Path) -> None:
    code, said = run("points.gpkg", "--grid", 4, *GP)
    assert code == 0, said
    for name in ("mean", "sigma", "support"):
        assert (folder / "reconstruction" / f"{name}.png").read_bytes().startswith(b"\x89PNG"), name
    assert "  next               firnline score reconstruction/dem.tif --truth REFERENCE" in said


def test_columns_of_a_table_are_chosen_by_a_mapping(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(1)
    rows = [f"{e:.3f};{n:.3f};{700.0:.3f};{748.7:.3f}" for e, n in rng.uniform(0.0, 40.0, (60, 2))]
    Path("rover.txt").write_text("\n".join(["E;N;Elevation;Ellipsoidal height", *rows, ""]))
    options = ("rover.txt", "--crs", CRS, "--sigma", 0.05, "--grid", 4, *GP)
    code, said = run(*options, "--columns", "z=Ellipsoidal height")
    assert code == 0, said
    assert "z_m = Ellipsoidal height" in caplog.text
    heights = Reconstruction.read(folder / "reconstruction").mean.elevation
    assert np.abs(heights - 748.7).max() < 0.1


def test_a_mapping_that_was_not_understood_or_is_of_no_use_ends_at_once(folder: Path) -> None:
    assert run("points.gpkg", "--columns", "height")[0] == 4
    code, said = run("points.gpkg", "--columns", "z=h")
    assert (code, "has no column 'h'" in " ".join(said.split())) == (3, True)


def _hills(n: int = 60) -> list[list[float]]:
    rng = np.random.default_rng(1)
    return [[x, y, 700.0 + np.sin(x / 9.0)] for x, y in rng.uniform(0.0, 40.0, (n, 2))]


def _table(rows: list[list[float]]) -> str:
    Path("rover.csv").write_text("x_m,y_m,z_m\n" + "".join(f"{x},{y},{z}\n" for x, y, z in rows))
    return "rover.csv"


def test_a_blunder_is_named_left_out_and_recorded(folder: Path) -> None:
    rows = _hills()
    rows[16][2] += 100.0
    options = (_table(rows), "--crs", CRS, "--sigma", 0.05, "--grid", 4, *GP)
    code, said = run(*options)
    assert code == 0, said
    assert "rover.csv: 1 point stands alone in height and counts as a blunder: it is point 17, at" in said
    result = Reconstruction.read(folder / "reconstruction")
    assert result.diagnostics["blunders"][0]["rows"] == [16]
    assert np.nanmax(result.mean.elevation) < 703.0
    assert "1 point stands alone" in run(*options, "--dry-run", "--force")[1]


def test_a_far_place_ends_at_once_unless_the_ground_is_named(folder: Path) -> None:
    rows = _hills()
    rows[16][:2] = [500_000.0, 6_700_000.0]
    options = (_table(rows), "--crs", CRS, "--sigma", 0.05, "--grid", 4, *GP)
    code, said = run(*options)
    assert code == 3
    assert "1 of 60 points lies far from all others: point 17 at 500000.00, 6700000.00" in said
    SurveyArea(shapely.box(0.0, 0.0, 40.0, 40.0), CRS).write("area.gpkg")
    assert run(*options, "--area", "area.gpkg")[0] == 0


def test_points_on_one_line_need_an_area(folder: Path) -> None:
    rows = [[500_000.0, 6_700_000.0 + k, 800.0 + 0.1 * k] for k in range(20)]
    options = (_table(rows), "--crs", CRS, "--sigma", 0.05, "--grid", 4, *GP)
    code, said = run(*options)
    assert code == 3
    assert "enclose nothing, as around points on one line; name the ground with --area" in said
    SurveyArea(shapely.box(499_990.0, 6_700_000.0, 500_010.0, 6_700_020.0), CRS).write("area.gpkg")
    assert run(*options, "--area", "area.gpkg")[0] == 0


def test_feet_among_metres_end_at_once(folder: Path) -> None:
    rows = _hills()
    rows[16][2] /= 0.3048
    code, said = run(_table(rows), "--crs", CRS, "--sigma", 0.05, "--grid", 4, *GP)
    assert code == 3
    assert "those are in feet, the first at point 17" in said
