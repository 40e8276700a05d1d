"""Glaciers with voids: filled by elevation, of the glacier itself or of the others."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid
from survey.io.vector import read_features, write_features
from survey.scoring import change
from survey.scoring.differencing.hypsometry import Hypsometry

GRID = Grid((0.0, 0.0, 1990.0, 990.0), 10.0, "EPSG:32608")
X, Y = np.meshgrid(GRID.x, GRID.y)
GLACIERS = {
    "west": shapely.box(195.0, 95.0, 705.0, 905.0),
    "east": shapely.box(1295.0, 95.0, 1805.0, 905.0),
}
ON_ICE = np.logical_or.reduce([shapely.contains_xy(shape, X, Y) for shape in GLACIERS.values()])
# 600 m of relief in 1 km, and a loss of 4 m at the snout that ends at the top.
HEIGHTS = 2000.0 + 0.6 * Y + 3.0 * np.sin(X / 50.0)
LOSS = np.where(ON_ICE, -4.0 * (1.0 - Y / 990.0), 0.0)


def surveys(void: np.ndarray) -> tuple[Dem, Dem]:
    noise = 0.1 * np.random.default_rng(1).standard_normal(GRID.shape)
    later = np.where(void, np.nan, HEIGHTS + LOSS + noise)
    return Dem.on(GRID, later), Dem.on(GRID, HEIGHTS)


def test_voids_of_one_end_are_filled_by_their_elevation() -> None:
    # Two fifths of the western snout: the mean of the mapped part alone is 0.6 m too small a loss.
    void = (X < 560.0) & (Y < 450.0) & ON_ICE
    found = change(*surveys(void), GLACIERS)
    west, east = found.volumes
    true_m = float(LOSS[shapely.contains_xy(GLACIERS["west"], X, Y)].mean())
    assert west.known_share < 0.75
    assert west.mean_m == pytest.approx(true_m, abs=0.03)
    assert 0.0 < west.void_std_m3 < west.std_m3
    assert east.void_std_m3 == 0.0
    assert any("filled with the mean change at its elevation" in note for note in found.notes)
    lowest = west.bands[0]
    assert (lowest.low_m, lowest.high_m) == (2040.0, 2060.0)
    assert sum(band.area_m2 for band in west.bands) == pytest.approx(west.area_m2, rel=0.03)


def test_a_band_without_mapped_cells_takes_that_of_the_other_glaciers() -> None:
    void = (X < 1000.0) & (Y < 400.0) & ON_ICE
    west = change(*surveys(void), GLACIERS).volumes[0]
    assert west.bands[0].known_share == 0.0
    assert west.mean_m == pytest.approx(
        float(LOSS[shapely.contains_xy(GLACIERS["west"], X, Y)].mean()), abs=0.05
    )


def test_a_band_that_no_glacier_maps_takes_the_nearest() -> None:
    areas, known = np.ones(GRID.shape), ~(ON_ICE & (HEIGHTS < 2200.0))
    inside = shapely.contains_xy(GLACIERS["west"], X, Y)
    filled = Hypsometry(HEIGHTS, LOSS, areas, known, ON_ICE).mean_over(inside, 0.0)
    band = LOSS[inside & (HEIGHTS >= 2200.0) & (HEIGHTS < 2220.0)].mean()
    assert filled.bands[0].mean_m == pytest.approx(band)
    assert filled.weights.sum() == pytest.approx(1.0)
    assert (filled.weights[~known] == 0.0).all()


def test_all_outlines_together_have_the_sum_of_the_volumes() -> None:
    found = change(*surveys(np.zeros(GRID.shape, dtype=bool)), GLACIERS)
    assert found.total is not None
    assert found.total.volume_m3 == pytest.approx(sum(one.volume_m3 for one in found.volumes), rel=1e-9)
    # The level is common to both, so that their errors do not average out as independent ones would.
    assert found.total.std_m3 > np.hypot(*(one.std_m3 for one in found.volumes))
    again = change(
        *surveys(np.zeros(GRID.shape, dtype=bool)), {**GLACIERS, "part": GLACIERS["west"].buffer(-50.0)}
    )
    assert again.total is None


def test_outlines_that_are_not_mapped_are_left_out_and_named() -> None:
    void = (X > 1000.0) & ON_ICE
    far = {"far": shapely.box(9e5, 9e5, 9.1e5, 9.1e5)}
    found = change(*surveys(void), {**GLACIERS, **far})
    assert [one.name for one in found.volumes] == ["west"]
    assert any(
        "2 of 3 outlines are left out" in note and note.endswith(": east, far") for note in found.notes
    )


def _written(folder: Path) -> list[str]:
    later, earlier = surveys(np.zeros(GRID.shape, dtype=bool))
    later.write(folder / "later.tif")
    earlier.write(folder / "earlier.tif")
    columns = {"RGIId": ["RGI60-17.00001", "RGI60-17.00002"], "Name": ["North glacier", ""]}
    arrays = {name: np.array(values, dtype=object) for name, values in columns.items()}
    write_features(folder / "ice.gpkg", [*GLACIERS.values()], arrays, GRID.crs, layer="ice")
    return [
        "change",
        str(folder / "later.tif"),
        str(folder / "earlier.tif"),
        "--no-pictures",
        "-o",
        str(folder / "out"),
    ]


def test_the_command_writes_a_table_and_polygons_with_the_numbers_of_the_inventory(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, [*_written(tmp_path), "--outline", str(tmp_path / "ice.gpkg")])
    assert done.exit_code == 0, done.output
    assert "all outlines:" in done.output
    rows = (tmp_path / "out" / "change.csv").read_text(encoding="utf-8").splitlines()
    assert [row.split(",")[:2] for row in rows[1:]] == [
        ["North glacier", "RGI60-17.00001"],
        ["RGI60-17.00002", "RGI60-17.00002"],
    ]
    features = read_features(tmp_path / "out" / "change.gpkg", what="the change")
    assert list(features.attributes["id"]) == ["RGI60-17.00001", "RGI60-17.00002"]
    assert "volume_std_m3" in features.attributes
    bands = (tmp_path / "out" / "change_bands.csv").read_text(encoding="utf-8").splitlines()
    assert len(bands) > 20


def test_the_difference_alone_needs_no_outline(tmp_path: Path) -> None:
    args = _written(tmp_path)
    done = CliRunner().invoke(app, [*args, "--json"])
    assert done.exit_code == 0, done.output
    facts = json.loads(done.stdout)
    assert facts["volumes"] == []
    assert facts["difference"]["n"] == GRID.shape[0] * GRID.shape[1]
    assert any("no unchanged ground is stated" in note for note in facts["notes"])
    # The slope to the north is the same everywhere but for noise: a shift along it is not fitted.
    assert facts["alignment"]["left_out"][:2] == ["east_m", "north_m"]
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"change.tif", "change.json"}
    chosen = CliRunner().invoke(app, [*args, "--force", "--select", "north"])
    assert (chosen.exit_code, "--outline" in chosen.output) == (3, True)
