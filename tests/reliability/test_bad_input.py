"""Every bad input ends in one sentence and exit code 3 or 4, and leaves what was there as it was."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from pyproj import CRS
from typer.testing import CliRunner

from benchmarks.bad_input.good import DEM_MISSION, MISSION, UTM, hills
from firnline.cli.main import app
from survey import Dem, Grid, SurveyArea
from survey.io.vector import write_features


def write_raw(path: Path, values: np.ndarray, crs: str | None = UTM, transform: Affine | None = None) -> None:
    """Write a GeoTIFF without any of firnline's checks."""
    height, width = values.shape
    profile = {"height": height, "width": width, "count": 1, "dtype": "float32", "nodata": -9999.0}
    place = transform or Affine(3.0, 0.0, 0.0, 0.0, -3.0, 150.0)
    with rasterio.open(path, "w", driver="GTiff", crs=crs, transform=place, **profile) as target:
        target.write(values.astype(np.float32), 1)


def good_dem(folder: Path) -> None:
    write_raw(folder / "dem.tif", hills())


Case = tuple[str, str, Callable[[Path], None], list[str], int, str]


def nothing(folder: Path) -> None:
    del folder


def truncated(folder: Path) -> None:
    good_dem(folder)
    content = (folder / "dem.tif").read_bytes()
    (folder / "dem.tif").write_bytes(content[: len(content) // 2])


def empty(folder: Path) -> None:
    (folder / "dem.tif").write_bytes(b"")


def text_as_raster(folder: Path) -> None:
    (folder / "dem.tif").write_text("this is no raster")


def folder_as_raster(folder: Path) -> None:
    (folder / "dem.tif").mkdir()


def without_crs(folder: Path) -> None:
    write_raw(folder / "dem.tif", hills(), crs=None)


def in_degrees(folder: Path) -> None:
    write_raw(folder / "dem.tif", hills(), crs="EPSG:4326", transform=Affine(3, 0, 0, 0, -3, 150))


def in_feet(folder: Path) -> None:
    write_raw(folder / "dem.tif", hills(), crs="EPSG:2225")


def all_nodata(folder: Path) -> None:
    write_raw(folder / "dem.tif", np.full((50, 50), -9999.0))


def one_cell(folder: Path) -> None:
    write_raw(folder / "dem.tif", np.ones((1, 1)))


def rotated(folder: Path) -> None:
    write_raw(folder / "dem.tif", hills(), transform=Affine.rotation(20.0) @ Affine(3, 0, 0, 0, -3, 150))


def mirrored(folder: Path) -> None:
    write_raw(folder / "dem.tif", hills(), transform=Affine(-3, 0, 150, 0, -3, 150))


def oblong_cells(folder: Path) -> None:
    write_raw(folder / "dem.tif", hills(), transform=Affine(3, 0, 0, 0, -4, 150))


def hole_inside(folder: Path) -> None:
    values = hills()
    values[20:25, 20:25] = -9999.0
    write_raw(folder / "dem.tif", values)


def not_a_number_inside(folder: Path) -> None:
    values = hills()
    values[30, 30] = np.nan
    write_raw(folder / "dem.tif", values)


def area(shape: shapely.Geometry, role: str = "area", crs: str = UTM) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        good_dem(folder)
        shapes, roles = [shape], [role]
        if role != "area":
            shapes, roles = [shapely.box(0, 0, 150, 150), shape], ["area", role]
        write_features(
            folder / "area.gpkg", shapes, {"role": np.array(roles, dtype=object)}, CRS(crs), layer="area"
        )

    return write


def truncated_area(folder: Path) -> None:
    area(shapely.box(10, 10, 140, 140))(folder)
    content = (folder / "area.gpkg").read_bytes()
    (folder / "area.gpkg").write_bytes(content[:5000])


WITH_AREA = DEM_MISSION + '[area]\nfile = "area.gpkg"\n'


def edited(old: str, new: str, text: str = MISSION) -> str:
    assert old in text
    return text.replace(old, new)


RUN = ["run", "m.toml", "--runs", "runs", "-q"]
BOWTIE = shapely.Polygon([(0, 0), (100, 100), (100, 0), (0, 100)])
MISSIONS: list[Case] = [
    ("truncated raster", DEM_MISSION, truncated, RUN, 3, "dem.tif is damaged"),
    ("empty raster", DEM_MISSION, empty, RUN, 3, "is empty"),
    ("missing raster", DEM_MISSION, nothing, RUN, 3, "does not exist"),
    ("text instead of a raster", DEM_MISSION, text_as_raster, RUN, 3, "damaged or no raster"),
    ("folder instead of a raster", DEM_MISSION, folder_as_raster, RUN, 3, "is a folder"),
    ("raster without CRS", DEM_MISSION, without_crs, RUN, 3, "no coordinate reference system"),
    ("metres called degrees", DEM_MISSION, in_degrees, RUN, 3, "assign the CRS that its metres count in"),
    ("raster in feet", DEM_MISSION, in_feet, RUN, 3, "survey feet"),
    ("all nodata", DEM_MISSION, all_nodata, RUN, 3, "no height at all"),
    ("1 × 1 raster", DEM_MISSION, one_cell, RUN, 3, "at least 2 × 2"),
    ("rotated raster", DEM_MISSION, rotated, RUN, 3, "rotated"),
    ("mirrored raster", DEM_MISSION, mirrored, RUN, 3, "northern"),
    ("oblong cells", DEM_MISSION, oblong_cells, RUN, 3, "square"),
    ("nodata inside the area", DEM_MISSION, hole_inside, RUN, 3, "no known terrain"),
    ("NaN inside the area", DEM_MISSION, not_a_number_inside, RUN, 3, "no known terrain"),
    (
        "area outside the raster",
        WITH_AREA,
        area(shapely.box(5000, 5000, 5100, 5100)),
        RUN,
        3,
        "no known terrain",
    ),
    ("self-crossing area", WITH_AREA, area(BOWTIE), RUN, 3, "not a simple polygon"),
    (
        "line instead of an area",
        WITH_AREA,
        area(shapely.LineString([(0, 0), (50, 50)])),
        RUN,
        3,
        "polygon was expected",
    ),
    ("area without ground", WITH_AREA, area(shapely.Polygon()), RUN, 3, "empty"),
    (
        "no-go covers everything",
        WITH_AREA,
        area(shapely.box(-1, -1, 151, 151), "no-go"),
        RUN,
        3,
        "cover the whole",
    ),
    ("unknown role", WITH_AREA, area(shapely.box(0, 0, 9, 9), "nogo"), RUN, 3, "role 'nogo'"),
    ("truncated area", WITH_AREA, truncated_area, RUN, 3, "area.gpkg"),
    ("missing area", WITH_AREA, good_dem, RUN, 3, "does not exist"),
    ("prior cells that do not fit", edited("cell_m = 75.0", "cell_m = 20.0"), nothing, RUN, 3, "20 m"),
    ("unknown key", edited("swaths = 2", "swathes = 2"), nothing, RUN, 4, "did you mean swaths"),
    ("unknown section", MISSION + "[sensor]\n", nothing, RUN, 4, "did you mean sensors"),
    ("wrong unit", edited("size_m", "size_km"), nothing, RUN, 4, "size_km"),
    (
        "negative noise",
        edited("[planner]", "[sensors]\ngps_white_sigma_m = -1.0\n[planner]"),
        nothing,
        RUN,
        4,
        "gps_white_sigma_m",
    ),
    ("zero swaths", edited("swaths = 2", "swaths = 0"), nothing, RUN, 4, "swaths"),
    ("half a swath", edited("swaths = 2", "swaths = 2.5"), nothing, RUN, 4, "swaths"),
    ("text for a number", edited("150.0", '"150"'), nothing, RUN, 4, "size_m"),
    ("negative seed", "seed = -1\n" + MISSION, nothing, RUN, 4, "seed"),
    ("later schema", edited("schema_version = 1", "schema_version = 2"), nothing, RUN, 4, "schema_version"),
    ("no planner", MISSION[: MISSION.index("[planner]")], nothing, RUN, 4, "planner"),
    ("name with a slash", edited('"m"', '"../m"'), nothing, RUN, 4, "name"),
    ("unknown terrain", edited('"random"', '"moon"'), nothing, RUN, 4, "moon"),
    (
        "file and bounds",
        WITH_AREA + "bounds_m = [0.0, 0.0, 9.0, 9.0]\n",
        good_dem,
        RUN,
        4,
        "exclude one another",
    ),
    ("broken TOML", "schema_version = ", nothing, RUN, 4, "not valid TOML"),
    ("empty mission", "", nothing, RUN, 3, "is empty"),
    ("malformed override", MISSION, nothing, [*RUN, "--set", "planner.swaths"], 4, "section.key=value"),
    ("unknown stage", MISSION, nothing, [*RUN, "--until", "scor"], 4, "no stage 'scor'"),
    ("missing mission", MISSION, nothing, ["run", "other.toml", "--runs", "runs"], 3, "does not exist"),
    ("a file where runs should go", MISSION, lambda f: (f / "runs").write_text("x"), RUN, 3, "runs"),
]


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def refused(args: list[str], code: int, words: str) -> None:
    result = CliRunner().invoke(app, args)
    assert result.exit_code == code, result.output
    assert not result.stdout.strip()
    assert re.search(re.escape(words), result.stderr), result.stderr
    assert result.stderr.startswith("firnline: ")
    assert result.stderr.strip().endswith((".", "?")), "not a sentence"
    assert len(result.stderr.strip().splitlines()) == 1
    assert "Traceback" not in result.stderr


@pytest.mark.reliability
@pytest.mark.parametrize(
    ("mission", "prepare", "args", "code", "words"), [c[1:] for c in MISSIONS], ids=[c[0] for c in MISSIONS]
)
def test_bad_missions(tmp_path, monkeypatch, mission, prepare, args, code, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.toml").write_text(mission)
    prepare(tmp_path)
    before = tree(tmp_path)
    refused(args, code, words)
    assert tree(tmp_path) == before


POINTS = "x_m,y_m,z_m,sigma_z_m\n" + "".join(
    f"{x}.0,{y}.0,{x + y}.0,0.1\n" for x in (1, 50, 99) for y in (2, 40, 97)
)
RECONSTRUCT = ["reconstruct", "points.csv", "--crs", UTM, "--grid", "10"]


def points(text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "points.csv").write_text(text) and None


def existing_map(folder: Path) -> None:
    points(POINTS)(folder)
    (folder / "reconstruction").mkdir()
    (folder / "reconstruction" / "dem.tif").write_bytes(b"precious")


def two_datums(folder: Path) -> None:
    grid = Grid((0.0, 0.0, 90.0, 90.0), 10.0, UTM)
    Dem.on(grid, np.zeros(grid.shape), "EGM96 height").write(folder / "map.tif")
    Dem.on(grid, np.zeros(grid.shape), "ellipsoidal height").write(folder / "truth.tif")


def two_systems(folder: Path) -> None:
    grid = Grid((0.0, 0.0, 90.0, 90.0), 10.0, UTM)
    Dem.on(grid, np.zeros(grid.shape)).write(folder / "map.tif")
    Dem.on(Grid(grid.bounds, 10.0, "EPSG:32609"), np.zeros(grid.shape)).write(folder / "truth.tif")


def far_apart(folder: Path) -> None:
    grid = Grid((0.0, 0.0, 90.0, 90.0), 10.0, UTM)
    Dem.on(grid, np.zeros(grid.shape)).write(folder / "map.tif")
    far = Grid((9000.0, 0.0, 9090.0, 90.0), 10.0, UTM)
    Dem.on(far, np.zeros(grid.shape)).write(folder / "truth.tif")


def square_area(folder: Path) -> None:
    SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), UTM).write(folder / "area.geojson")


SCORE = ["score", "map.tif", "--truth", "truth.tif"]
TOOLS: list[tuple[str, Callable[[Path], None], list[str], int, str]] = [
    ("points without CRS", points(POINTS), ["reconstruct", "points.csv"], 3, "coordinate reference system"),
    ("missing points", nothing, RECONSTRUCT, 3, "does not exist"),
    ("empty points", points(""), RECONSTRUCT, 3, "is empty"),
    ("header alone", points(POINTS.splitlines()[0] + "\n"), RECONSTRUCT, 3, "no rows"),
    ("cut off in a row", points(POINTS[:-12]), RECONSTRUCT, 3, "line 10"),
    ("missing column", points(POINTS.replace("z_m,", "of_what,", 1)), RECONSTRUCT, 3, "z_m"),
    ("words for numbers", points(POINTS.replace("50.0,40.0", "fifty,40.0")), RECONSTRUCT, 3, "fifty"),
    ("NaN height", points(POINTS.replace("50.0,40.0,90.0", "50.0,40.0,nan")), RECONSTRUCT, 3, "NaN"),
    ("zero sigma", points(POINTS.replace("0.1", "0.0")), RECONSTRUCT, 3, "0 or less"),
    ("negative sigma", points(POINTS.replace("0.1", "-0.1")), RECONSTRUCT, 3, "0 or less"),
    ("two points", points("\n".join(POINTS.splitlines()[:3]) + "\n"), RECONSTRUCT, 3, "2"),
    (
        "points on one line",
        points("x_m,y_m,z_m,sigma_z_m\n" + "".join(f"{i}.0,{i}.0,1.0,0.1\n" for i in range(9))),
        [*RECONSTRUCT, "--method", "tin"],
        3,
        "line",
    ),
    ("unknown method", points(POINTS), [*RECONSTRUCT, "--method", "magic"], 3, "magic"),
    (
        "grid step zero",
        points(POINTS),
        ["reconstruct", "points.csv", "--crs", UTM, "--grid", "0"],
        3,
        "greater than 0",
    ),
    ("unknown quantity", points(POINTS), [*RECONSTRUCT, "--value", "temperature_c"], 3, "temperature_c"),
    ("degrees", points(POINTS), ["reconstruct", "points.csv", "--crs", "EPSG:4326"], 3, "metres"),
    ("a map that is there", existing_map, RECONSTRUCT, 3, "exists"),
    ("two vertical datums", two_datums, SCORE, 3, "vertical datums"),
    ("two systems", two_systems, SCORE, 3, "different systems"),
    ("no common ground", far_apart, SCORE, 3, "no"),
    ("no reference", two_datums, ["score", "map.tif"], 3, "--truth"),
    ("no run folder", nothing, ["show", "."], 3, "no run folder"),
    ("zero swaths", square_area, ["plan", "area.geojson", "--swaths", "0"], 4, "swaths"),
    ("unknown route format", square_area, ["plan", "area.geojson", "-o", "route.docx"], 3, ".docx"),
    (
        "route into a missing folder",
        square_area,
        ["plan", "area.geojson", "-o", "no/route.geojson"],
        3,
        "does not exist",
    ),
    (
        "mission file that is there",
        lambda f: (f / "a.toml").write_text("x") and None,
        ["init", "a.toml"],
        3,
        "exists",
    ),
]


@pytest.mark.reliability
@pytest.mark.parametrize(
    ("prepare", "args", "code", "words"), [c[1:] for c in TOOLS], ids=[c[0] for c in TOOLS]
)
def test_bad_input_to_single_commands(tmp_path, monkeypatch, prepare, args, code, words):
    monkeypatch.chdir(tmp_path)
    prepare(tmp_path)
    before = tree(tmp_path)
    refused(args, code, words)
    assert tree(tmp_path) == before
