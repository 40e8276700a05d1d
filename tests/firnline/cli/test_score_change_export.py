"""Checkpoints, exports and refusals from the command line."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid, InputError
from survey.io.point_files import read_point_table
from survey.io.vector import write_features
from survey.scoring.differencing import change_files

UTM = "EPSG:32608"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A map that is 5 cm off at checkpoints spread evenly over it."""
    monkeypatch.chdir(tmp_path)
    grid = Grid((0.0, 0.0, 600.0, 600.0), 10.0, UTM)
    x, y = np.meshgrid(grid.x, grid.y)
    plane = Dem.on(grid, 100.0 + 0.1 * x - 0.05 * y, "EGM96 height")
    plane.write("map.tif")
    places = np.stack(np.meshgrid(np.arange(45.0, 600.0, 100.0), np.arange(45.0, 600.0, 110.0)), -1).reshape(
        -1, 2
    )
    heights = plane.at(places) + 0.05 * np.where(np.arange(len(places)) % 2 == 0, 1.0, -1.0)
    rows = [f"P{k},{e},{n},{z},0.02\n" for k, ((e, n), z) in enumerate(zip(places, heights, strict=True))]
    Path("all.csv").write_text("name,x_m,y_m,z_m,sigma_z_m\n" + "".join(rows[:36]))
    Path("few.csv").write_text("name,x_m,y_m,z_m,sigma_z_m\n" + "".join(rows[:29]))
    return tmp_path


def output_of(*args: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, list(args))
    assert done.exit_code == code, done.output
    return done.stdout if code == 0 else done.stderr


def test_checkpoints_are_judged_by_a_named_edition(site: Path) -> None:
    args = ("--class", "0.10", "--datum", "EGM96 height", "--json")
    for file, n, outcome in (("few.csv", 29, "not assessed to the standard"), ("all.csv", None, "met")):
        found = json.loads(output_of("score", "map.tif", "--checkpoints", file, *args))
        finding = found["assessments"][0]
        assert finding["outcome"] == outcome
        assert "Edition 2" in finding["edition"]
        assert finding["n"] == (n or len(Path(file).read_text().splitlines()) - 1)
        assert found["elevation"]["rmse_m"] == pytest.approx(0.05, abs=1e-5)
    words = output_of("score", "map.tif", "--checkpoints", "few.csv", "--standard", "nssda-1998")
    assert "tested accuracy at 95 % 0.098 m" in words
    assert "tens of metres" in words


def test_a_wanted_class_that_is_not_met_ends_with_its_exit_code_and_keeps_the_report(site: Path) -> None:
    wanted = ("--class", "0.04", "--datum", "EGM96 height", "--report", "accuracy")
    output_of("score", "map.tif", "--checkpoints", "all.csv", *wanted, code=5)
    assert any(Path("accuracy").iterdir())


def test_a_report_states_project_client_instrument_and_dates(site: Path) -> None:
    score = ("score", "map.tif", "--checkpoints", "all.csv", "--datum", "EGM96 height")
    details = ("--detail", "check-date=2026-07-01", "--detail", "client=Glacier Office")
    output_of(*score, *details, "--report", "accuracy.html")
    page = Path("accuracy.html").read_text(encoding="utf-8")
    assert page.index("Glacier Office") < page.index("2026-07-01")
    assert "Date of the check survey" in page
    assert "add --report" in output_of(*score, *details, code=3)
    assert "project, client" in output_of(*score, "--detail", "colour=red", "--report", "x.html", code=4)


def test_the_survey_without_a_datum_is_named(site: Path) -> None:
    args = _surveys(site)
    later = Dem.read("later.tif")
    Dem(later.elevation, later.transform, later.crs).write("later.tif")
    words = output_of(*args)
    assert "the later survey does not state its vertical datum" in words
    assert "the earlier survey does not" not in words
    assert "vertical datum" not in output_of(*args, "--force", "--datum", "EGM96 height")
    assert "vertical datums" in output_of(*args, "--force", "--datum", "ellipsoidal height", code=3)


def test_checkpoints_that_are_control_unknown_standards_and_other_datums_are_refused(site: Path) -> None:
    score = ("score", "map.tif", "--checkpoints", "all.csv")
    assert "within 0.1 m of control" in output_of(*score, "--control", "few.csv", code=3)
    assert "asprs-2014" in output_of(*score, "--standard", "asprs-2020", code=4)
    assert "vertical datums" in output_of(*score, "--datum", "ellipsoidal height", code=3)


def test_a_map_goes_through_every_format_and_back(site: Path) -> None:
    output_of("export", "map.tif", "map.nc")
    output_of("export", "map.nc", "map.asc")
    output_of("export", "map.asc", "again.tif", "--crs", UTM)
    np.testing.assert_array_equal(Dem.read("again.tif").elevation, Dem.read("map.tif").elevation)
    output_of("export", "all.csv", "points.laz", "--crs", UTM, code=3)
    assert "not known" in output_of("export", "map.tif", "x.gpkg", "--as", "poem", code=4)


LOCAL = 'LOCAL_CS["site grid",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'


def test_score_assigns_the_named_crs_to_rasters_in_a_local_one(site: Path) -> None:
    plane = Dem.read("map.tif")
    Dem(plane.elevation, plane.transform, LOCAL).write("local.tif")
    refusal = output_of("score", "local.tif", "--truth", "map.tif", code=3)
    assert "is a local one (LOCAL_CS) that cannot be reprojected" in refusal
    assert "--crs" in refusal
    assert "  RMSE               0.000 m" in output_of(
        "score", "local.tif", "--truth", "map.tif", "--crs", UTM
    )
    assert "was named" in output_of("score", "local.tif", "--truth", "map.tif", "--crs", "EPSG:32609", code=3)


def test_score_in_blocks_assigns_the_named_crs_too(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("firnline.actions.scoring.LARGE", 100)
    plane = Dem.read("map.tif")
    Dem(plane.elevation, plane.transform, LOCAL).write("local.tif")
    assert "  RMSE               0.000 m" in output_of(
        "score", "local.tif", "--truth", "map.tif", "--crs", UTM
    )


def test_an_export_replaces_nothing_without_force_and_never_its_input(site: Path) -> None:
    before = Path("map.tif").read_bytes()
    Path("map.nc").write_text("mine")
    assert "map.nc exists" in output_of("export", "map.tif", "map.nc", code=3)
    assert Path("map.nc").read_text() == "mine"
    assert "is or contains the input" in output_of("export", "map.tif", "map.tif", "--force", code=3)
    Path("other.prj").write_text("mine")
    assert "other.prj exists" in output_of("export", "map.tif", "other.asc", code=3)
    assert (Path("other.prj").read_text(), Path("other.asc").exists()) == ("mine", False)
    output_of("export", "map.tif", "map.nc", "--force")
    assert Path("map.tif").read_bytes() == before


def test_a_refused_export_leaves_what_was_there(site: Path) -> None:
    Path("points.laz").write_text("mine")
    output_of("export", "all.csv", "points.laz", "--crs", UTM, "--force", code=3)
    assert Path("points.laz").read_text() == "mine"


def _surveys(folder: Path) -> list[str]:
    plane = Dem.read(folder / "map.tif")
    rough = plane.elevation + np.random.default_rng(2).normal(0.0, 0.1, plane.shape)
    Dem(rough, plane.transform, plane.crs, plane.vertical_datum).write(folder / "later.tif")
    names = {"name": np.array(["=cmd|' /C calc'!A0\x1b[2J"], dtype=object)}
    write_features(folder / "ice.gpkg", [shapely.box(200, 200, 400, 400)], names, plane.crs, layer="ice")
    return ["change", "later.tif", "map.tif", "--outline", "ice.gpkg", "-o", "out"]


def test_change_replaces_nothing_without_force_and_no_file_of_others(site: Path) -> None:
    args = _surveys(site)
    output_of(*args)
    old = Path("out/change.csv").read_bytes()
    assert "out exists" in output_of(*args, code=3)
    output_of(*args, "--force", "--no-level")
    assert Path("out/change.csv").read_bytes() != old
    Path("out/notes.txt").write_text("mine")
    assert "notes.txt" in output_of(*args, "--force", code=3)
    assert Path("out/notes.txt").read_text() == "mine"
    assert "contains the input" in output_of(*args[:-1], ".", "--force", code=3)


@pytest.mark.pictures
def test_a_change_that_fails_leaves_the_old_one(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    args = _surveys(site)
    output_of(*args)
    old = {file.name: file.read_bytes() for file in Path("out").iterdir()}

    def full(*_: object) -> bytes:
        raise InputError("the disk is full")

    monkeypatch.setattr("survey.figures.style.picture_bytes", full)
    output_of(*args, "--force", "--no-level", code=3)
    assert {file.name: file.read_bytes() for file in Path("out").iterdir()} == old


@pytest.mark.pictures
def test_the_pictures_of_a_change_and_of_its_report_are_drawn_in_the_chosen_format(site: Path) -> None:
    output_of(*_surveys(site), "--pictures", "svg", "--report", "stated")
    assert [file.name for file in Path("out").glob("change.*") if file.suffix in (".png", ".svg")] == [
        "change.svg"
    ]
    assert [file.name for file in Path("stated/figures").iterdir()] == ["change.svg"]


def test_names_of_outlines_are_escaped_in_tables_and_on_the_terminal(site: Path) -> None:
    said = output_of(*_surveys(site))
    assert "\x1b" not in said
    table = Path("out/change.csv").read_text(encoding="utf-8")
    assert "\x1b" not in table
    assert "'=cmd" in table


def test_a_gnss_export_is_judged_by_its_usual_columns_or_by_a_mapping(site: Path) -> None:
    rows = [line.split(",") for line in Path("all.csv").read_text().splitlines()[1:]]
    export = "".join(f"{n};{x};{y};{z};0.01;{s};ICE\n".replace(".", ",") for n, x, y, z, s in rows)
    Path("gnss.csv").write_text("Point;Easting;Northing;Elevation;SDH;SDV;Code\n" + export)
    Path("odd.csv").write_text("Point;a;b;c;SDH;s;Code\n" + export)
    args = ("--class", "0.10", "--datum", "EGM96 height", "--json")
    expected = output_of("score", "map.tif", "--checkpoints", "all.csv", *args)
    assert output_of("score", "map.tif", "--checkpoints", "gnss.csv", *args) == expected
    mapping = ("--columns", "x=a,y=b,z=c", "--columns", "sigma_z=s")
    assert output_of("score", "map.tif", "--checkpoints", "odd.csv", *mapping, *args) == expected
    assert "no column 'q'" in output_of(
        "score", "map.tif", "--checkpoints", "odd.csv", "--columns", "x=q", code=3
    )
    assert "key=column" in output_of("score", "map.tif", "--checkpoints", "odd.csv", "--columns", "q", code=4)


def test_large_surveys_are_averaged_before_they_are_compared(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(change_files, "LARGEST_CELLS", 2_000)
    monkeypatch.setattr(change_files, "_AVERAGED_CELLS", 1_000)
    assert "averaged over squares of about 19" in output_of(*_surveys(site))
    assert Dem.read("out/change.tif").step_m == 20.0


def test_checkpoints_beyond_the_map_are_counted(site: Path) -> None:
    with Path("all.csv").open("a") as file:
        file.write("far,90000.0,0.0,100.0,0.02\n")
    words = output_of("score", "map.tif", "--checkpoints", "all.csv")
    assert "1 checkpoints lie outside the area that is judged and are left out" in words


def test_a_vertical_datum_that_one_raster_alone_states_is_noted(site: Path) -> None:
    dem = Dem.read("map.tif")
    Dem(dem.elevation, dem.transform, dem.crs).write("unstated.tif")
    words = output_of("score", "map.tif", "--truth", "unstated.tif")
    assert "note: the map states EGM96 height, and the reference no vertical datum" in words
    named = output_of(
        "score", "unstated.tif", "--truth", "map.tif", "--datum", "EGM96 height", "--report", "named"
    )
    assert "vertical datum" not in named
    assert "EGM96 height" in Path("named/index.html").read_text(encoding="utf-8")
    dem.write("copy.tif")
    assert "vertical datum" not in output_of("score", "map.tif", "--truth", "copy.tif")


def test_the_datum_of_a_named_crs_counts(site: Path) -> None:
    dem = Dem.read("map.tif")
    Dem(dem.elevation, dem.transform, dem.crs).write("unstated.tif")
    Dem(dem.elevation, dem.transform, dem.crs, "ellipsoidal height").write("ellipsoidal.tif")
    refused = output_of("score", "unstated.tif", "--truth", "ellipsoidal.tif", "--crs", f"{UTM}+5773", code=3)
    assert "vertical datums" in refused
    Path("points.csv").write_text("x_m,y_m,z_m\n10.0,20.0,5.0\n")
    output_of("export", "points.csv", "points.gpkg", "--as", "points", "--crs", f"{UTM}+5773")
    assert read_point_table("points.gpkg").vertical_datum == "EGM96 height"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--truth", "reference.tif", "--class", "0.1"), "--class belongs to --checkpoints"),
        (("--truth", "reference.tif", "--standard", "nssda-1998"), "--standard belongs to --checkpoints"),
        (("--truth", "reference.tif", "--checkpoints", "all.csv"), "were both given"),
        (("--truth", "map.tif"), "is the map and its own reference"),
    ],
)
def test_options_that_would_have_no_effect_are_refused(
    site: Path, options: tuple[str, ...], said: str
) -> None:
    Path("reference.tif").touch()
    assert said in " ".join(output_of("score", "map.tif", *options, code=3).split())


def test_a_reference_of_wider_cells_is_noted(site: Path) -> None:
    grid = Grid((0.0, 0.0, 600.0, 600.0), 100.0, UTM)
    x, y = np.meshgrid(grid.x, grid.y)
    Dem.on(grid, 100.0 + 0.1 * x - 0.05 * y, "EGM96 height").write("coarse.tif")
    assert "cells of the reference are 100 m wide" in output_of("score", "map.tif", "--truth", "coarse.tif")


def test_checkpoints_in_feet_are_converted_and_results_are_in_both(site: Path) -> None:
    height = float(Dem.read("map.tif").at([[45.0, 45.0]])[0]) + 0.3048
    Path("feet.csv").write_text(f"Point,E,N,Elevation (ft),SDV\nA,45,45,{height / 0.3048!r},0.01\n")
    chosen = ("--columns", "z=Elevation (ft)")
    assert "0.305 m (1.001 ft)" in output_of("score", "map.tif", "--checkpoints", "feet.csv", *chosen)
    Path("bare.csv").write_text(f"A,45,45,{height / 0.3048!r},mark\n")
    options = ("--format", "penzd", "--units", "ft", "--sigma", "0.01")
    assert "0.305 m (1.001 ft)" in output_of("score", "map.tif", "--checkpoints", "bare.csv", *options)


def test_a_change_states_the_subtracted_level_and_outlines_that_are_mapped_in_part(site: Path) -> None:
    args = _surveys(site)
    later = Dem.read("later.tif")
    raised = later.elevation + 2.0
    raised[:, 32:] = np.nan
    Dem(raised, later.transform, later.crs, later.vertical_datum).write("later.tif")
    words = output_of(*args, "--no-align")
    assert re.search(r"\+(1\.99|2\.00)\d m subtracted, the median difference of the unchanged ground", words)
    assert re.search(r"note: both surveys map \d\d% of", words)


def test_a_density_that_is_no_material_is_refused(site: Path) -> None:
    assert "kg/m³ were expected" in output_of(*_surveys(site), "--density", "0.85", code=4)
