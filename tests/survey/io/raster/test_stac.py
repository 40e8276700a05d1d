"""STAC items of rasters: what a catalogue needs to find a map."""

import hashlib
import json
from datetime import date

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Grid
from survey.core import InputError
from survey.interchange.stac import write_stac_item
from survey.io.raster import write_raster

GRID = Grid((500_000.0, 6_700_000.0, 500_040.0, 6_700_030.0), 1.0, "EPSG:32608")


@pytest.fixture
def map_file(tmp_path):
    """A map with two bands and a hole."""
    z = 300.0 + np.arange(np.prod(GRID.shape), dtype=np.float64).reshape(GRID.shape)
    z[:3] = np.nan
    dem = Dem.on(GRID, z)
    (tmp_path / "maps").mkdir()
    write_raster(
        tmp_path / "maps" / "dem.tif",
        {"elevation": z, "sigma": np.full(z.shape, 0.1)},
        dem.transform,
        dem.crs,
        "EGM2008",
    )
    return tmp_path / "maps" / "dem.tif", z


def item_of(path):
    return json.loads(path.read_text(encoding="utf-8"))


def test_an_item_states_place_projection_and_bands(map_file, tmp_path):
    file, z = map_file
    write_stac_item(file, tmp_path / "dem.json", date(2026, 5, 1))
    item = item_of(tmp_path / "dem.json")
    assert (item["type"], item["stac_version"], item["id"]) == ("Feature", "1.1.0", "dem")
    assert item["properties"]["datetime"] == "2026-05-01T12:00:00Z"
    assert item["properties"]["proj:code"] == "EPSG:32608"
    assert item["properties"]["proj:shape"] == list(z.shape)
    west, south, east, north = item["bbox"]
    assert -135.01 < west < east < -134.99
    assert (north - south) * 111_400.0 == pytest.approx(z.shape[0], rel=0.01)
    outline = np.array(item["geometry"]["coordinates"][0])
    assert outline[0].tolist() == outline[-1].tolist()
    x, y = (outline - outline.mean(axis=0)).T
    assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0.0  # counter-clockwise
    asset = item["assets"]["map"]
    assert asset["href"] == "maps/dem.tif"
    assert asset["type"].endswith("profile=cloud-optimized")
    assert "EGM2008" in asset["description"]
    assert asset["file:checksum"] == "1220" + hashlib.sha256(file.read_bytes()).hexdigest()
    first, second = asset["bands"]
    assert (first["name"], second["name"]) == ("elevation", "sigma")
    assert first["statistics"]["mean"] == pytest.approx(np.nanmean(z), rel=1e-6)
    assert first["statistics"]["stddev"] == pytest.approx(np.nanstd(z), rel=1e-4)
    assert first["statistics"]["valid_percent"] == pytest.approx(100.0 * np.isfinite(z).mean(), abs=1e-2)


def test_a_survey_of_several_days_has_an_interval(map_file, tmp_path):
    write_stac_item(map_file[0], tmp_path / "dem.json", date(2026, 5, 1), date(2026, 5, 4))
    found = item_of(tmp_path / "dem.json")["properties"]
    assert (found["datetime"], found["start_datetime"], found["end_datetime"]) == (
        None,
        "2026-05-01T00:00:00Z",
        "2026-05-04T23:59:59Z",
    )


def test_days_in_the_wrong_order_and_a_raster_without_a_crs_are_refused(map_file, tmp_path):
    with pytest.raises(InputError, match="is before the first"):
        write_stac_item(map_file[0], tmp_path / "dem.json", date(2026, 5, 4), date(2026, 5, 1))
    (tmp_path / "plain.asc").write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n")
    with pytest.raises(InputError, match="has no CRS"):
        write_stac_item(tmp_path / "plain.asc", tmp_path / "plain.json", date(2026, 5, 4))
    assert not (tmp_path / "dem.json").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "name its day with --days"),
        (["--days", "May"], "is no day such as 2026-05-01"),
        (["--days", "2026-05-01,2026-05-02,2026-05-03"], "names 3 days"),
    ],
)
def test_export_asks_for_the_days_of_an_item(map_file, tmp_path, words, said):
    out = tmp_path / "dem.json"
    result = CliRunner().invoke(app, ["export", str(map_file[0]), str(out), *words])
    assert result.exit_code == 4
    assert said in result.stderr
    assert not out.exists()


def test_days_go_with_items_alone(map_file, tmp_path):
    words = ["export", str(map_file[0]), str(tmp_path / "dem.asc"), "--days", "2026-05-01"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 4
    assert "--days goes with STAC items" in result.stderr


def test_export_writes_an_item_by_the_ending(map_file, tmp_path):
    out = tmp_path / "dem.json"
    result = CliRunner().invoke(app, ["export", str(map_file[0]), str(out), "--days", "2026-05-01"])
    assert result.exit_code == 0, result.output
    assert item_of(out)["assets"]["map"]["href"] == "maps/dem.tif"
