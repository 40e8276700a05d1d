"""What is written comes back, read by another tool; what is damaged is refused in one sentence."""

from pathlib import Path

import laspy
import numpy as np
import plyfile
import pyogrio
import pytest
import rasterio
import shapely
from affine import Affine
from pyproj import CRS
from rio_cogeo.cogeo import cog_validate

from benchmarks.format_samples import SAMPLES, flipped, mutated, put, truncated
from survey import Dem, Grid, InputError, SurveyArea
from survey.core.errors import FirnlineError
from survey.data.trajectory import Trajectory
from survey.interchange.conversion import convert, kind_of
from survey.io.point_files import read_point_table
from survey.io.raster import read_raster, write_raster
from survey.io.trajectory_files import read_kitti, read_track, read_tum

UTM = "EPSG:32608"
GRID = Grid((500_000.0, 6_700_000.0, 500_090.0, 6_700_050.0), 10.0, UTM)


@pytest.fixture
def dem() -> Dem:
    heights = np.random.default_rng(0).normal(1000.0, 10.0, GRID.shape).astype(np.float32).astype(np.float64)
    heights[0, 0] = np.nan
    return Dem.on(GRID, heights, "EGM96 height")


def test_outside_readers_find_the_same_heights(dem: Dem, tmp_path: Path) -> None:
    for ending in ("tif", "asc", "nc"):
        dem.write(tmp_path / f"map.{ending}")
        back = Dem.read(tmp_path / f"map.{ending}")
        np.testing.assert_array_equal(back.elevation, dem.elevation)
        assert back.transform.almost_equals(dem.transform)
        assert back.crs.equals(dem.crs, ignore_axis_order=True)
        # An ASCII grid states no vertical datum.
        assert back.vertical_datum == ("" if ending == "asc" else "EGM96 height")
    with rasterio.open(tmp_path / "map.tif") as source:
        np.testing.assert_array_equal(source.read(1, masked=True).filled(np.nan), dem.elevation)
    assert cog_validate(tmp_path / "map.tif")[0]
    lines = (tmp_path / "map.asc").read_text().splitlines()
    assert lines[0].split() == ["ncols", "10"]
    np.testing.assert_array_equal(np.loadtxt(lines[6:]).astype(np.float32)[1:], dem.elevation[1:])
    xarray = pytest.importorskip("xarray", reason="xarray is not installed (firnline[netcdf])")
    with xarray.open_dataset(tmp_path / "map.nc", engine="h5netcdf") as dataset:
        np.testing.assert_array_equal(dataset["elevation"].values, dem.elevation)
        np.testing.assert_array_equal(dataset["y"].values, dem.y)
        assert CRS.from_cf(dataset["spatial_ref"].attrs).sub_crs_list[0].to_epsg() == 32608


def test_several_bands_need_a_format_that_holds_them(dem: Dem, tmp_path: Path) -> None:
    bands = {"elevation": dem.elevation, "standard_deviation": np.full(dem.shape, 0.5)}
    write_raster(tmp_path / "two.nc", bands, dem.transform, dem.crs)
    assert read_raster(tmp_path / "two.nc", band=2).values[1, 1] == 0.5
    with pytest.raises(InputError, match="one band, not 2"):
        write_raster(tmp_path / "two.asc", bands, dem.transform, dem.crs)
    assert not list(tmp_path.glob("two.asc*"))


def test_points_are_read_by_other_tools(tmp_path: Path) -> None:
    for ending in (".las", ".laz", ".ply", ".gpkg", ".csv"):
        SAMPLES[f"points{ending}"].write(tmp_path / f"points{ending}")
    expected = read_point_table(tmp_path / "points.csv").columns
    for ending in (".las", ".laz"):
        # LAS keeps tenths of a millimetre.
        np.testing.assert_allclose(
            laspy.read(tmp_path / f"points{ending}").x, expected["x_m"], atol=6e-5, rtol=0
        )
    vertices = plyfile.PlyData.read(tmp_path / "points.ply")["vertex"]
    np.testing.assert_array_equal(vertices["z"], expected["z_m"])
    _, _, geometry, _ = pyogrio.raw.read(tmp_path / "points.gpkg")
    places = shapely.get_coordinates(shapely.from_wkb(geometry), include_z=True)
    np.testing.assert_array_equal(places[:, 2], expected["z_m"])


def test_areas_are_read_by_other_tools_and_shapefiles_are_whole(tmp_path: Path) -> None:
    area = SurveyArea(shapely.box(500_000, 6_700_000, 500_600, 6_700_500), UTM)
    for ending in ("geojson", "gpkg", "kml", "shp"):
        area.write(tmp_path / f"area.{ending}")
        back = SurveyArea.read(tmp_path / f"area.{ending}", crs=UTM)
        # KML is in degrees, with 15 digits.
        assert shapely.hausdorff_distance(back.polygon, area.polygon) < 1e-5
        meta, _, geometry, _ = pyogrio.raw.read(tmp_path / f"area.{ending}")
        shape = shapely.from_wkb(geometry)[0]
        inside = shapely.Point(500_300, 6_700_250) if meta["crs"] != "EPSG:4326" else shape.centroid
        assert shape.contains(inside)
    assert {f.suffix for f in tmp_path.glob("area.*")} >= {".shp", ".shx", ".dbf", ".prj"}
    with pytest.raises(InputError, match="one kind of geometry"):
        SurveyArea(area.polygon, UTM, starts=[[500_050.0, 6_700_050.0]]).write(tmp_path / "both.shp")


def test_tracks_are_converted_and_read_by_other_tools(tmp_path: Path) -> None:
    n = 20
    time_s = 0.25 * np.arange(n)
    place = np.column_stack([500_000 + 3 * time_s, 6_700_000 + 7 * time_s, 1000 + time_s])
    turn = np.tile([0.0, 0.0, np.sin(0.3), np.cos(0.3)], (n, 1))
    Trajectory(time_s, place, turn, np.zeros((n, 3, 3)), UTM).write(tmp_path / "path.csv")
    for ending in ("tum", "txt", "gpx", "gpkg"):
        convert(tmp_path / "path.csv", tmp_path / f"path.{ending}", "track", crs=UTM)
    np.testing.assert_array_equal(read_tum(tmp_path / "path.tum"), np.column_stack([time_s, place, turn]))
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "path.tum"), read_tum(tmp_path / "path.tum"))
    poses = read_kitti(tmp_path / "path.txt")
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "path.txt").reshape(-1, 3, 4), poses)
    assert poses[0, 1, 0] == pytest.approx(np.sin(0.6))
    for ending, step in (("gpx", 2e-4), ("gpkg", 0.0)):
        times, places = read_track(tmp_path / f"path.{ending}", CRS(UTM))
        np.testing.assert_allclose(places, place, rtol=0, atol=step)
        np.testing.assert_array_equal(times, time_s)
    meta, _, _, columns = pyogrio.raw.read(tmp_path / "path.gpx", layer="track_points")
    assert dict(zip(meta["fields"], columns, strict=True))["ele"][4] == 1001.0
    with pytest.raises(InputError, match="KITTI"):
        convert(tmp_path / "path.csv", tmp_path / "path.docx", "track", crs=UTM)
    assert kind_of(tmp_path / "path.csv", "path.gpx") == "track"


def test_a_track_that_was_cut_off_between_two_lines_is_named(tmp_path: Path) -> None:
    SAMPLES["track.tum"].write(tmp_path / "a.tum")
    lines = (tmp_path / "a.tum").read_text().splitlines(keepends=True)
    (tmp_path / "a.tum").write_text("".join(lines[:-3]))
    with pytest.raises(InputError, match="37 of 40 poses"):
        read_tum(tmp_path / "a.tum")


def read(name: str, path: Path) -> str:
    """Read a damaged file: ``answer`` or ``refused``; anything else is raised."""
    said = ""
    try:
        SAMPLES[name].read(path)
    except FirnlineError as refusal:
        said = str(refusal)
    assert "\n" not in said
    assert not said or said.endswith((".", "?"))
    return "refused" if said else "answer"


# GDAL's own words about a damaged header may hold bytes of it, which rasterio then cannot log.
unlogged = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


def times(name: str, n: int, n_slow: int) -> int:
    """Return a number for a sample: each NetCDF is first read by a process of its own, which takes its time."""
    return n_slow if name == "dem.nc" else n


@unlogged
@pytest.mark.reliability
@pytest.mark.parametrize("name", SAMPLES)
def test_damaged_files_give_an_answer_or_one_sentence(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    SAMPLES[name].write(path)
    whole = path.read_bytes()
    for content in (*flipped(whole, times(name, 8, 2)), *flipped(whole, times(name, 8, 2), n_bits=30)):
        put(path, content)
        read(name, path)
    for content in [*truncated(whole)][:: times(name, 1, 4)]:
        put(path, content)
        # KITTI has no header, and its lines are equally long here: a cut between two of them cannot be seen.
        assert read(name, path) == "refused" or name == "track.txt"
    # These carry a checksum of their values, or of their blocks.
    if name in ("dem.tif", "dem.nc", "points.las", "points.laz", "points.ply", "track.tum"):
        put(path, whole)
        good = SAMPLES[name].read(path)
        for content in flipped(whole, times(name, 25, 3)):
            put(path, content)
            assert read(name, path) == "refused" or SAMPLES[name].read(path) == good


@unlogged
@pytest.mark.reliability
@pytest.mark.parametrize("n", [10, pytest.param(100, marks=pytest.mark.exhaustive)])
def test_random_damage_finds_no_other_exception(tmp_path: Path, n: int) -> None:
    """A slice of what ``python -m benchmarks.fuzz_formats`` does for as long as one likes."""
    for name, sample in SAMPLES.items():
        path = tmp_path / name
        sample.write(path)
        whole = path.read_bytes()
        for seed in range(times(name, n, n // 5)):
            put(path, mutated(whole, np.random.default_rng(seed)))
            read(name, path)


@unlogged
@pytest.mark.reliability
@pytest.mark.parametrize(
    ("name", "seed"), [("dem.tif", 1537), ("points.las", 1592), ("points.laz", 1), ("points.laz", 50053)]
)
def test_cases_that_random_damage_once_found(name: str, seed: int, tmp_path: Path) -> None:
    """22 GB for 21,761 bands, a division by 0 in a header, a panic of the decompressor."""
    path = tmp_path / name
    SAMPLES[name].write(path)
    put(path, mutated(path.read_bytes(), np.random.default_rng(seed)))
    assert read(name, path) == "refused"


@pytest.mark.reliability
def test_headers_that_claim_too_much_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    (tmp_path / "a.asc").write_text(
        "ncols 1000000\nnrows 1000000\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n"
    )
    with pytest.raises(InputError, match="holds 3 numbers"):
        read_raster(tmp_path / "a.asc")
    (tmp_path / "a.ply").write_text(
        "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty double x\nend_header\n"
    )
    with pytest.raises(InputError, match="claims 4,000,000,000 points"):
        read_point_table(tmp_path / "a.ply")
    for ending, place, words in (
        (".las", 247, "claims"),
        (".laz", 247, "claims"),
        (".las", 100, "more records"),
    ):
        path = tmp_path / f"points{ending}"
        SAMPLES[f"points{ending}"].write(path)
        content = bytearray(path.read_bytes())
        content[place : place + 4] = b"\xff\xff\xff\x7f"
        put(path, content)
        with pytest.raises(InputError, match=words):
            read_point_table(path)


@pytest.mark.reliability
def test_wrong_and_missing_systems_are_refused(tmp_path: Path) -> None:
    values = np.ones((5, 5), dtype=np.float32)
    place = Affine(10.0, 0.0, 0.0, 0.0, -10.0, 50.0)
    for crs, words in (
        (None, "no coordinate reference system"),
        ("EPSG:4326", "measures 5,... km; one projected CRS"),
        ("EPSG:2225", "its places count in US survey feet; name the unit of the heights with --units"),
    ):
        profile = {"height": 5, "width": 5, "count": 1, "dtype": "float32", "driver": "GTiff"}
        with rasterio.open(tmp_path / "a.tif", "w", crs=crs, transform=place, **profile) as target:
            target.write(values, 1)
        with pytest.raises(InputError, match=words):
            Dem.read(tmp_path / "a.tif")
    with rasterio.open(tmp_path / "a.tif", "w", crs="EPSG:32608+6360", transform=place, **profile) as target:
        target.write(values, 1)
    read = Dem.read(tmp_path / "a.tif")
    assert read.vertical_datum == "NAVD88 height"
    assert read.elevation == pytest.approx(np.full((5, 5), 1200.0 / 3937.0))
