"""``firnline counts``: maps, facts and picture of counts, and refusals that name the option or the column."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from sim.instruments.counter import RadiationWorld
from survey import Dem
from survey.core.streams import stream

SOURCE = np.array([500_070.0, 6_700_060.0])


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Counts on lines over a source."""
    file = tmp_path_factory.mktemp("counts") / "gamma.csv"
    east, north = np.meshgrid(np.arange(5.0, 120.0, 10.0), np.arange(10.0, 120.0, 20.0))
    xy = np.column_stack([east.ravel(), north.ravel()]) + [500_000.0, 6_700_000.0]
    world = RadiationWorld(SOURCE, 1e4, 8.0, stream(1, "command"))
    world.count(xy, np.full(len(xy), 10.0)).write(file)
    return file


def run(log: Path, out: Path, *options: str, code: int = 0) -> str:
    command = ["counts", str(log), "--crs", "EPSG:32608", "--grid", "5", "--out", str(out), *options]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == code, result.output
    return result.output


@pytest.mark.pictures
def test_maps_facts_and_picture_are_written_and_the_source_is_found(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "counts"
    said = run(log, out, "--source", "radiation", "--limit", "20", "--next-from", "500010,6700020")
    assert {file.name for file in out.iterdir()} >= {
        "intensity.tif", "lower.tif", "upper.tif", "below_limit.tif", "counts.json", "counts.png", "interval.png",
    }  # fmt: skip
    low, middle, high = (Dem.read(out / f"{name}.tif").elevation for name in ("lower", "intensity", "upper"))
    assert np.all(low < middle)
    assert np.all(middle < high)
    found = json.loads((out / "counts.json").read_text())["source"]
    assert np.hypot(found["easting_m"] - SOURCE[0], found["northing_m"] - SOURCE[1]) <= 10.0
    assert "within 10 m with a probability of" in said
    east, north = found["next_place_m"]
    assert 500_000.0 <= east <= 500_120.0
    assert f"next count: {east:.1f} m E, {north:.1f} m N" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--source", "plume"), "wind_east_m_s"),
        (("--half-life", "60"), "--source plume"),
        (("--limit", "-1"), "--limit"),
        (("--next-from", "500010,6700020"), "--source radiation"),
        (("--source", "radiation", "--next-from", "here"), "--next-from"),
        (("--grid", "0.01"), "--grid"),
    ],
)
def test_what_cannot_be_done_is_refused(
    log: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    said = run(log, tmp_path / "none", *options, code=3 if words == "--grid" else 4)
    assert words in said
    assert not (tmp_path / "none").exists()
