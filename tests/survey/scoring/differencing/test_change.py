"""Change between surveys: recovered where it happened, doubtful where errors could have made it."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from benchmarks.change_worlds import World, exponential_field, landlab_pair, model_pair, raster_pair
from firnline.cli.main import app
from survey import Dem, Grid, InputError, Reconstruction
from survey.core.map_scale import ground_area_m2
from survey.io.vector import write_features
from survey.scoring import change
from survey.scoring.differencing.coregistration import align
from survey.scoring.differencing.variogram import Structure, SumErrors, Variogram
from survey.scoring.differencing.volume_change import VolumeChange

UTM = "EPSG:32608"
GRID = Grid((0.0, 0.0, 590.0, 590.0), 10.0, UTM)
ICE = {"ice": shapely.Point(300.0, 300.0).buffer(150.0)}
SMALL = World(n_cells=90, step_m=10.0)


def pair(seed: int = 1, noise: float = 0.2) -> tuple[Dem, Dem]:
    """Hills, and the same 3 m lower on the ice, 0.7 m higher everywhere."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(GRID.x, GRID.y)
    hills = 100.0 + 25.0 * np.sin(x / 60.0) + 20.0 * np.cos(y / 50.0)
    inside = shapely.contains_xy(ICE["ice"], x, y)
    later = hills - 3.0 * inside + 0.7 + rng.normal(0.0, noise, hills.shape)
    return Dem.on(GRID, later, "EGM96 height"), Dem.on(GRID, hills, "EGM96 height")


def test_the_change_is_found_and_a_common_offset_is_not_part_of_it() -> None:
    found = change(*pair(), ICE)
    volume = found.volumes[0]
    # 700 cells of 0.2 m each and 2,900 of calm ground: 0.0085 m on the mean.
    assert volume.mean_m == pytest.approx(-3.0, abs=4 * 0.0085)
    assert found.offset_m == pytest.approx(0.7, abs=0.02)
    assert volume.std_m3 / volume.area_m2 == pytest.approx(0.0085, rel=0.3)
    assert volume.known_share == pytest.approx(1.0)
    significant = np.asarray(found.significant)
    inside = shapely.contains_xy(ICE["ice"], *GRID.xy.T).reshape(GRID.shape)
    assert (significant[inside] == -1).all()
    # One in twenty cells that did not change; 2,900 of them scatter by 0.4 %.
    assert np.mean(significant[~inside] != 0) == pytest.approx(0.05, abs=0.02)


def test_correlated_errors_widen_the_interval_far_beyond_the_naive_one() -> None:
    found = [raster_pair(seed, SMALL) for seed in range(5)]
    assert all(pair.std_m3 > 5.0 * pair.naive_std_m3 for pair in found)
    assert sum(pair.holds for pair in found) >= 4


def test_models_carry_their_joint_posterior() -> None:
    found = model_pair(3, n_points=60)
    assert found.std_m3 > found.naive_std_m3
    assert abs(found.error_m3) < 4.0 * found.std_m3


def test_a_real_landslide_is_recovered(real_data: Path) -> None:
    found = landlab_pair(real_data)
    assert found.worst_m < 1e-9
    assert found.volume_off < 1e-9


def test_white_errors_average_out_and_shared_ones_do_not() -> None:
    weights, everywhere = np.full((20, 20), 1.0 / 400.0), np.ones((20, 20), dtype=bool)
    white = SumErrors(Variogram(1.0), everywhere, 10.0).of(weights)
    assert white.std == pytest.approx(1.0 / 20.0)
    assert white.n_free == pytest.approx(400.0)
    # A range of 100 times the raster: all cells err together.
    shared = SumErrors(Variogram(0.0, (Structure("spherical", 20_000.0),)), everywhere, 10.0).of(weights)
    assert shared.std == pytest.approx(1.0, abs=0.01)
    assert shared.n_free == pytest.approx(1.0, abs=0.03)


def test_a_variogram_is_learnt_through_holes() -> None:
    rng = np.random.default_rng(5)
    known = rng.random((150, 150)) > 0.3
    field = 0.5 * exponential_field(rng, 150, 6.0)
    found = Variogram.of(np.where(known, field, np.nan), known, 10.0)
    expected = 0.25 * (1.0 - np.exp(-np.array([20.0, 60.0, 150.0]) / 60.0))
    # 22,500 cells hold some 200 independent patches: 10 % of a variance.
    np.testing.assert_allclose(found.at(np.array([20.0, 60.0, 150.0])), expected, rtol=0.25)


def test_unseen_parts_of_an_outline_widen_its_interval_and_half_of_it_is_needed() -> None:
    later, earlier = pair()
    whole = change(later, earlier, ICE).volumes[0]
    heights = later.elevation.copy()
    heights[25:32, :] = np.nan
    part = change(Dem.on(GRID, heights, "EGM96 height"), earlier, ICE).volumes[0]
    assert part.known_share < 0.9
    assert part.std_m3 > 2.0 * whole.std_m3
    heights[20:45, :] = np.nan
    with pytest.raises(InputError, match="are needed for a volume"):
        change(Dem.on(GRID, heights, "EGM96 height"), earlier, ICE)


def test_stated_deviations_shape_the_significance() -> None:
    _, earlier = pair()
    x = np.meshgrid(GRID.x, GRID.y)[0]
    stds = np.where(x > 300.0, 0.5, 0.05)
    rng = np.random.default_rng(2)
    hills = earlier.elevation
    maps = [
        Reconstruction(
            Dem.on(GRID, hills + stds * rng.normal(size=GRID.shape)),
            Dem.on(GRID, stds),
            np.full(GRID.shape, 3),
            "gp",
            {},
        )
        for _ in range(2)
    ]
    found = change(maps[0], maps[1], ICE)
    west, east = (float(np.median(found.std_m[mask])) for mask in (x < 250.0, x > 350.0))
    # Two surveys: sqrt(2) of each.
    assert west == pytest.approx(0.05 * 2**0.5, rel=0.1)
    assert east == pytest.approx(0.5 * 2**0.5, rel=0.1)


def test_surveys_are_laid_on_one_another() -> None:
    _, earlier = pair(noise=0.0)
    x, y = np.meshgrid(GRID.x, GRID.y)
    moved = 100.0 + 25.0 * np.sin((x - 7.0) / 60.0) + 20.0 * np.cos((y + 4.0) / 50.0) + 2.0
    shift = align(earlier, Dem.on(GRID, moved, "EGM96 height"), only_shift=True).alignment
    # Bilinear cells of 10 m on hills of 50 m wave number.
    assert (shift.east_m, shift.north_m, shift.up_m) == pytest.approx((7.0, -4.0, 2.0), abs=0.05)
    assert shift.nmad_after_m < 0.1 * shift.nmad_before_m
    flat = align(Dem.on(GRID, 0.0 * x), Dem.on(GRID, 0.0 * x + 1.0), only_shift=True).alignment
    assert flat.left_out == ("east_m", "north_m")


def test_xdem_finds_the_same(real_data: Path) -> None:
    pytest.importorskip("xdem", reason="xdem is not installed (firnline[peers])")
    from benchmarks.xdem_judge import agreement

    statistics, shift_m, true_m = agreement(real_data)
    assert statistics < 1e-6
    # 0.1 m of noise on 50,000 cells of moderate slopes; both trim and interpolate in their own way.
    assert shift_m < 0.05
    assert true_m < 0.05


def test_mass_knows_the_doubt_of_the_density() -> None:
    lost = VolumeChange("ice", 1e6, 1.0, -2.0, -2e6, 1e5, 2e5, 1e3)
    mass = lost.mass(900.0, 90.0)
    assert mass.mass_kg == pytest.approx(-1.8e9)
    assert mass.mass_std_kg == pytest.approx(np.hypot(900.0 * 1e5, 90.0 * 2e6))
    assert mass.specific_m_we == pytest.approx(-1.8)
    with pytest.raises(InputError, match="density"):
        lost.mass(-1.0)


def test_an_interval_is_doubted_where_one_survey_was_filled_from_the_other() -> None:
    rng = np.random.default_rng(6)
    grid = Grid((0.0, 0.0, 390.0, 390.0), 10.0, "EPSG:32608")
    before = Dem.on(grid, rng.normal(0.0, 0.2, grid.shape))
    after = Dem.on(grid, before.elevation + 2.0 * (np.hypot(grid.x - 200, grid.y[:, None] - 200) < 100.0))
    ice = {"ice": shapely.Point(200.0, 200.0).buffer(100.0)}
    assert any("the interval is too narrow" in note for note in change(after, before, ice).notes)
    noisy = Dem.on(grid, after.elevation + rng.normal(0.0, 0.1, grid.shape))
    assert not any("the interval is too narrow" in note for note in change(noisy, before, ice).notes)


def test_refusals() -> None:
    later, earlier = pair()
    far = {"far": shapely.Point(9e5, 9e5).buffer(10.0)}
    ellipsoidal = Dem.on(GRID, earlier.elevation, "ellipsoidal height")
    for surveys, outlines, words in (
        ((later, ellipsoidal), ICE, "vertical datums"),
        ((later, earlier), far, "holds no cell"),
        ((later, earlier), {"all": shapely.box(-50.0, -50.0, 700.0, 700.0)}, "unchanged ground"),
    ):
        with pytest.raises(InputError, match=words):
            change(*surveys, outlines)


def test_the_command_writes_map_table_and_figure(tmp_path: Path) -> None:
    later, earlier = pair()
    later.write(tmp_path / "later.tif")
    earlier.write(tmp_path / "earlier.tif")
    names = {"name": np.array(["Lemon Creek"], dtype=object)}
    write_features(tmp_path / "ice.gpkg", [ICE["ice"]], names, earlier.crs, layer="ice")
    args = [
        "change",
        *(str(tmp_path / n) for n in ("later.tif", "earlier.tif")),
        "--outline",
        str(tmp_path / "ice.gpkg"),
    ]
    args += ["--align", "-o", str(tmp_path / "out"), "--json"]
    done = CliRunner().invoke(app, args)
    assert done.exit_code == 0, done.output
    row = json.loads(done.stdout)["volumes"][0]
    assert row["name"] == "Lemon Creek"
    sunk_m3 = -3.0 * ground_area_m2(UTM, ICE["ice"])
    assert row["volume_low_95_m3"] < sunk_m3 < row["volume_high_95_m3"]
    assert {f.name for f in (tmp_path / "out").iterdir()} == {
        "change.tif", "change.csv", "change_bands.csv", "change.gpkg", "change.json", "change.png",
    }  # fmt: skip
    again = CliRunner().invoke(app, args)
    assert (again.exit_code, "exists" in again.stderr) == (3, True)


def test_a_subtracted_offset_beyond_errors_of_surveys_is_stated() -> None:
    later, earlier = pair()
    in_feet = Dem.on(GRID, earlier.elevation / 0.3048, "EGM96 height")
    assert (
        "median difference of the unchanged ground, were subtracted" in change(later, in_feet, ICE).notes[0]
    )
    assert not any("were subtracted" in note for note in change(later, earlier, ICE).notes)
