"""Distances between point clouds by M3C2: exact where the answer is known, held by their levels of detection, refused in a sentence."""

import csv
import json
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
import shapely
from typer.testing import CliRunner

from firnline import actions
from firnline.actions.interface import preview_of
from firnline.cli.main import app
from survey import InputError, SurfacePoints
from survey.core.arrays import BoolArray, FloatArray
from survey.io.vector import write_features
from survey.scoring.differencing.cloud_change import change_of_clouds
from survey.scoring.differencing.m3c2 import CloudDistances, core_points, m3c2

UTM = "EPSG:32608"
WEST, SOUTH = 500_000.0, 6_700_000.0
SIGMA_M = 0.03


def cloud(
    seed: int, slope_deg: float = 0.0, moved_m: float = 0.0, n: int = 6000, sigma_m: float = SIGMA_M
) -> SurfacePoints:
    """Points on a plane of 40 x 40 m that rises to the east, moved along its normal."""
    rng = np.random.default_rng(seed)
    along, across = rng.uniform(-20.0, 20.0, (2, n))
    angle = np.deg2rad(slope_deg)
    xyz = np.column_stack([along * np.cos(angle), across, along * np.sin(angle)])
    xyz += moved_m * np.array([-np.sin(angle), 0.0, np.cos(angle)]) + rng.normal(0.0, sigma_m, (n, 3))
    return placed(xyz)


def placed(xyz: FloatArray) -> SurfacePoints:
    return SurfacePoints(xyz + (WEST, SOUTH, 300.0), sigma_m=1.0, crs=UTM, vertical_datum="EGM96 height")


def held(found: CloudDistances, true_m: float) -> BoolArray:
    result: BoolArray = np.abs(found.distance_m - true_m) <= found.lod_m
    return result


@pytest.mark.parametrize("slope_deg", [0.0, 30.0, 80.0])
def test_a_plane_that_moved_is_found_along_its_normal(slope_deg: float) -> None:
    found = m3c2(cloud(1, slope_deg, 0.1), cloud(2, slope_deg), registration_m=0.0)
    n = len(found.distance_m)
    assert n > 150
    assert found.distance_m.mean() == pytest.approx(0.1, abs=4.0 * 0.01 / np.sqrt(n))
    angle = np.deg2rad(slope_deg)
    assert np.allclose(found.normals.mean(axis=0), (-np.sin(angle), 0.0, np.cos(angle)), atol=0.01)
    # The binomial scatter of the share is 1.7 % for 170 core points.
    assert held(found, 0.1).mean() == pytest.approx(0.95, abs=0.055)
    scatter_m = (found.distance_m - 0.1).std()
    assert scatter_m == pytest.approx(np.sqrt(np.mean(found.sampling_std_m**2)), rel=0.15)


def test_distances_are_those_of_points_counted_one_by_one() -> None:
    """The reference takes each core point alone, without columns, sums and compiled code."""
    rng = np.random.default_rng(5)
    rough = [
        np.column_stack([xy := rng.uniform(-6.0, 6.0, (1500, 2)), 0.7 * xy[:, 0] + np.sin(2.0 * xy[:, 1])])
        for _ in range(2)
    ]
    later, earlier = placed(rough[0] + (0.0, 0.0, 0.2)), placed(rough[1])
    found = m3c2(
        later, earlier, registration_m=0.01, normals_m=(2.0, 4.0), cylinder_m=1.5, depth_m=1.2, spacing_m=2.0
    )
    assert set(found.normal_scale_m) == {2.0, 4.0}
    for i in range(0, len(found.distance_m), 5):
        core, normal = found.xyz[i], found.normals[i]
        assert normal == pytest.approx(_flattest_normal(earlier.xyz, core), abs=1e-6)
        parts = [_along(one.xyz, core, normal, 0.75, 1.2) for one in (later, earlier)]
        assert [len(part) for part in parts] == [found.n_later[i], found.n_earlier[i]]
        assert found.distance_m[i] == pytest.approx(parts[0].mean() - parts[1].mean(), abs=1e-8)
        std_m = np.sqrt(sum(part.var(ddof=1) / len(part) for part in parts))
        assert found.sampling_std_m[i] == pytest.approx(std_m, rel=1e-6)
        assert found.lod_m[i] > 1.96 * (std_m + 0.01)


def _flattest_normal(xyz: FloatArray, core: FloatArray) -> FloatArray:
    best = []
    for radius in (1.0, 2.0):
        near = xyz[((xyz - core) ** 2).sum(axis=1) <= radius**2]
        values, vectors = np.linalg.eigh(np.cov((near - core).T, bias=True))
        best.append((values[0] / values.sum(), vectors[:, 0] * np.sign(vectors[2, 0])))
    return min(best, key=lambda one: one[0])[1]


def _along(xyz: FloatArray, core: FloatArray, normal: FloatArray, radius: float, depth: float) -> FloatArray:
    along = (xyz - core) @ normal
    across = ((xyz - core) ** 2).sum(axis=1) - along**2
    return along[(np.abs(along) <= depth) & (across <= radius**2)]


def test_few_points_widen_the_level_by_students_t() -> None:
    sparse = [cloud(seed, n=600) for seed in (1, 2)]
    found = m3c2(*sparse, registration_m=0.0, normals_m=(20.0,), cylinder_m=3.5, spacing_m=4.0)
    few = np.minimum(found.n_later, found.n_earlier) < 5
    many = np.minimum(found.n_later, found.n_earlier) > 5
    assert few.any()
    ratio = found.lod_m / found.sampling_std_m
    assert ratio[few].mean() > ratio[many].mean() > 2.0
    assert held(found, 0.0).mean() >= 0.9
    assert min(found.n_later.min(), found.n_earlier.min()) >= 4
    assert found.n_without > 0


def test_a_registration_error_widens_every_level_by_1_96_of_it() -> None:
    plain, stated = (m3c2(cloud(1), cloud(2), registration_m=error) for error in (0.0, 0.02))
    assert np.allclose(stated.lod_m - plain.lod_m, 1.959964 * 0.02)
    assert np.allclose(stated.std_m, np.hypot(plain.sampling_std_m, 0.02))
    assert np.allclose(plain.registered(0.0, 0.02).lod_m, stated.lod_m)


def test_scales_follow_from_spacing_roughness_and_distance() -> None:
    far, near = (m3c2(cloud(1, moved_m=moved), cloud(2), registration_m=0.0) for moved in (8.0, 0.0))
    # 6,000 points on 1,600 m²: 30 in a circle of 3.2 m across.
    assert near.scales.cylinder_m == pytest.approx(3.2, rel=0.05)
    assert near.scales.normals_m == tuple(near.scales.cylinder_m * np.array([1.0, 2.0, 4.0]))
    assert near.scales.depth_m < 8.0 < far.scales.depth_m
    assert np.median(far.distance_m) == pytest.approx(8.0, abs=0.02)
    rough = m3c2(cloud(1, sigma_m=0.3), cloud(2, sigma_m=0.3), registration_m=0.0)
    assert rough.scales.normals_m[0] > near.scales.normals_m[0]
    assert rough.scales.normals_m[0] >= 25.0 * 0.25


def test_core_points_are_points_of_the_cloud_and_one_for_each_cube() -> None:
    xyz = np.random.default_rng(1).uniform(0.0, 10.0, (5000, 3))
    cores = core_points(xyz, 2.5)
    assert len(cores) == 64
    assert {tuple(core) for core in cores} <= {tuple(point) for point in xyz}
    assert np.abs(cores % 2.5 - 1.25).max() < 0.7


def changed(offset_m: float = 0.3) -> tuple[SurfacePoints, SurfacePoints]:
    """A slope that sank by 0.5 m within 12 m of its middle, and whose later cloud lies too high."""
    later, earlier = (cloud(seed, 20.0, n=12_000).xyz - (WEST, SOUTH, 300.0) for seed in (3, 4))
    sank = np.hypot(later[:, 0], later[:, 1]) < 12.0
    later[:, 2] += offset_m - 0.5 * sank
    return placed(later), placed(earlier)


OUTLINE = {"slide": shapely.Point(WEST, SOUTH).buffer(14.0)}


def test_unchanged_ground_levels_the_clouds_and_gives_the_registration_error() -> None:
    found = change_of_clouds(*changed(), OUTLINE, spacing_m=1.0)
    assert found.offset_m == pytest.approx(0.3, abs=0.005)
    assert found.distances.registration_m < 0.01
    assert not found.is_stated
    assert found.change is not None
    assert found.change.method == "m3c2"
    volume = found.change.volumes[0]
    true_m3 = -0.5 * np.pi * 12.0**2
    assert abs(volume.volume_m3 - true_m3) < 1.5 * volume.half_width_95_m3 < 0.1 * abs(true_m3)
    off = np.hypot(*(found.distances.xyz[:, :2] - (WEST, SOUTH)).T)
    assert (found.distances.significant[off < 10.0] == -1).all()
    assert (found.distances.significant[off > 14.0] != 0).mean() < 0.1
    kept = change_of_clouds(*changed(), OUTLINE, level=False, spacing_m=1.0)
    assert kept.offset_m == 0.0
    # What was not subtracted is an error of the registration.
    assert kept.distances.registration_m > 0.25


def test_a_cliff_has_distances_and_no_map() -> None:
    found = change_of_clouds(cloud(1, 80.0, 0.1), cloud(2, 80.0), registration_m=0.01)
    assert found.change is None
    assert found.facts(850.0, 60.0)["m3c2"]["median_m"] == pytest.approx(0.1, abs=0.01)
    assert any("steeper than 60°" in note for note in found.notes)
    with pytest.raises(InputError, match="steeper than 60°"):
        change_of_clouds(cloud(1, 80.0), cloud(2, 80.0), stable=shapely.Point(WEST, SOUTH).buffer(50.0))


def test_cells_that_miss_the_area_of_an_outline_are_noted() -> None:
    coarse = change_of_clouds(
        *changed(), {"strip": shapely.box(WEST - 8, SOUTH - 3, WEST + 8, SOUTH + 4)}, spacing_m=3.0
    )
    assert any("of its area" in note for note in coarse.notes)


def test_what_cannot_be_compared_is_refused_in_a_sentence() -> None:
    one = cloud(1)
    with pytest.raises(InputError, match="--registration"):
        change_of_clouds(one, one)
    far = SurfacePoints(one.xyz + (500.0, 0.0, 0.0), sigma_m=1.0, crs=UTM)
    with pytest.raises(InputError, match="check that they overlap"):
        m3c2(far, one, registration_m=0.0)
    with pytest.raises(InputError, match="a positive one"):
        m3c2(one, one, registration_m=0.0, cylinder_m=-1.0)
    with pytest.raises(InputError, match="0 or more"):
        m3c2(one, one, registration_m=float("nan"))
    with pytest.raises(InputError, match="9 are needed"):
        m3c2(one.select(np.arange(5)), one, registration_m=0.0)
    twice = SurfacePoints(np.repeat(one.xyz[:20], 10, axis=0), sigma_m=1.0, crs=UTM)
    with pytest.raises(InputError, match="coincide"):
        m3c2(twice, one, registration_m=0.0)


# ---- the command
def written(folder: Path) -> tuple[Path, Path, Path]:
    """Write the later cloud as LAZ, half of it vegetation, the earlier one as a table without a header, and the outline."""
    later, earlier = changed()
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-4), later.xyz.min(axis=0)
    header.add_crs(later.crs)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.concatenate([later.xyz, later.xyz + (0.0, 0.0, 2.0)]).T
    las.classification = np.repeat(np.uint8([2, 5]), len(later))
    files = folder / "later.laz", folder / "earlier.xyz", folder / "slide.gpkg"
    las.write(str(files[0]))
    np.savetxt(files[1], earlier.xyz, fmt="%.4f")
    write_features(
        files[2],
        list(OUTLINE.values()),
        {"name": np.array(["slide"], dtype=object)},
        later.crs,
        layer="slide",
    )
    return files


def test_the_command_writes_points_map_volumes_and_record(tmp_path: Path) -> None:
    later, earlier, outline = written(tmp_path)
    out = tmp_path / "change"
    options = ["--method", "m3c2", "--crs", UTM, "--format", "xyz", "--outline", str(outline), "--grid", "1"]
    ran = CliRunner().invoke(app, ["change", str(later), str(earlier), *options, "-o", str(out)])
    assert ran.exit_code == 0, ran.output
    assert "from the unchanged ground" in ran.output
    assert "12000 of 24000 points are used, ground by class" in ran.output
    names = {"change.tif", "change.csv", "change.gpkg", "change.json", "change.png", "change_bands.csv"}
    assert {one.name for one in out.iterdir()} == names | {
        f"change_points.{e}" for e in ("csv", "laz", "png")
    }
    record = json.loads((out / "change.json").read_text())
    assert record["method"] == "m3c2"
    assert record["m3c2"]["scales"]["spacing_m"] == 1.0
    with (out / "change_points.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == record["m3c2"]["n"] == len(laspy.read(out / "change_points.laz").points)
    assert all(float(row["lod_m"]) > 1.96 * float(row["sampling_std_m"]) for row in rows)
    with rasterio.open(out / "change.tif") as raster:
        assert raster.res == (1.0, 1.0)
        assert np.nanmin(raster.read(1, masked=True).filled(np.nan)) == pytest.approx(-0.5, abs=0.1)
    assert record["volumes"][0]["mean_change_m"] == pytest.approx(-0.5 * (12.0 / 14.0) ** 2, abs=0.02)


def request(files: tuple[Path, Path, Path], **options: object) -> actions.ChangeRequest:
    settings = {"method": "m3c2", "crs": UTM, "layout": "xyz", "no_pictures": True, **options}
    return actions.ChangeRequest(
        later=files[0],
        earlier=files[1],
        out=files[0].with_name("out"),
        **settings,  # type: ignore[arg-type]
    )


def test_a_preview_counts_the_points_and_writes_nothing(tmp_path: Path) -> None:
    files = written(tmp_path)
    made = preview_of(actions.change, request(files, registration_m=0.02, ground="all"))
    assert made.stated == {"later": "24,000 points", "earlier": "12,000 points"}
    assert not (tmp_path / "out").exists()


def test_equal_clouds_give_equal_bytes(tmp_path: Path) -> None:
    files = written(tmp_path)
    for name in ("one", "two"):
        actions.change(request(files, registration_m=0.02)).write(tmp_path / name)
    for file in (tmp_path / "one").iterdir():
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "--registration"),
        ({"registration_m": 0.02, "align": True}, "--align is of maps"),
        ({"registration_m": 0.02, "flow": "track"}, "--flow is of maps"),
        ({"registration_m": 0.02, "select": ["slide"]}, "add --outline"),
        ({"method": None}, "compare two clouds with --method m3c2"),
        ({"method": None, "cylinder_m": 2.0}, "--cylinder is of point clouds"),
    ],
)
def test_options_of_maps_and_clouds_are_kept_apart(
    tmp_path: Path, options: dict[str, object], message: str
) -> None:
    files = written(tmp_path)
    given = {"layout": None, **options} if options.get("method", "m3c2") is None else options
    with pytest.raises(InputError, match=message):
        actions.change(request(files, **given))


def test_rasters_are_no_clouds(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is none; name clouds"):
        actions.ChangeRequest(later=tmp_path / "a.tif", earlier=tmp_path / "b.tif", method="m3c2").check()
