"""Scoring in blocks gives what scoring in memory gives."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely

import survey
from survey import Dem, Grid, InputError, Reconstruction, SurveyArea
from survey.io.raster import write_raster
from survey.scoring import scores
from survey.scoring.scores import ErrorSketch

UTM = "EPSG:32608"


@pytest.fixture
def rasters(tmp_path: Path) -> tuple[Path, Path]:
    """A map of 60 × 80 cells with holes and a stated deviation, and a reference on another grid that ends earlier."""
    rng = np.random.default_rng(4)
    grid, finer = Grid((5.0, 5.0, 795.0, 595.0), 10.0, UTM), Grid((2.0, 1.0, 702.0, 601.0), 4.0, UTM)

    def hills(g: Grid) -> np.ndarray:
        x, y = np.meshgrid(g.x, g.y)
        return 50.0 + 9.0 * np.sin(x / 70.0) * np.cos(y / 90.0)

    heights = hills(grid) + rng.normal(0.2, 0.4, grid.shape)
    heights[10:14, 20:30] = np.nan
    truth = hills(finer)
    truth[100:110, 30:50] = np.nan
    bands = {"elevation": heights, "standard_deviation": np.full(grid.shape, 0.4)}
    write_raster(tmp_path / "map.tif", bands, grid.transform, grid.crs, "EGM96 height")
    Dem.on(finer, truth, "EGM96 height").write(tmp_path / "truth.tif")
    return tmp_path / "map.tif", tmp_path / "truth.tif"


@pytest.mark.parametrize("filled", ["map.tif", "truth.tif"])
def test_a_patch_of_an_undeclared_number_is_refused_in_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, filled: str
) -> None:
    monkeypatch.setattr(scores, "BLOCK_CELLS", 16)
    grid = Grid((5.0, 5.0, 795.0, 595.0), 10.0, UTM)
    for name in ("map.tif", "truth.tif"):
        heights = 800.0 + 0.1 * np.add.outer(grid.y, grid.x)
        if name == filled:
            heights[20:40, 30:60] = 0.0
        Dem.on(grid, heights, "EGM96 height").write(tmp_path / name)
    with pytest.raises(InputError, match=rf"{filled} holds \d+ cells of exactly 0 m.*make it nodata"):
        scores.score_files(tmp_path / "map.tif", tmp_path / "truth.tif")


@pytest.mark.parametrize("side", [16, 1024])
@pytest.mark.parametrize("with_area", [False, True])
def test_blocks_and_memory_agree(
    rasters: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, side: int, with_area: bool
) -> None:
    monkeypatch.setattr(scores, "BLOCK_CELLS", side)
    area = SurveyArea(shapely.Point(400.0, 300.0).buffer(250.0), UTM) if with_area else None
    mean, std = (Dem.read(rasters[0], band=k) for k in (1, 2))
    whole = survey.score(
        Reconstruction(mean, std, np.full(mean.shape, 3), "gp", {}), truth=Dem.read(rasters[1]), area=area
    )
    found = scores.score_files(*rasters, area)
    for name, value in vars(whole.elevation).items():
        # Quantiles lie between the same two errors, of which some 2,000 are 0.4 m wide: neighbours are 0.5 mm apart,
        # and 5 mm in the tail.
        assert getattr(found.elevation, name) == pytest.approx(value, rel=1e-6, abs=5e-3), name
    assert found.elevation.rmse_m == pytest.approx(whole.elevation.rmse_m, rel=1e-9)
    assert found.calibration.shares == pytest.approx(whole.calibration.shares)
    assert found.calibration.z_rms == pytest.approx(whole.calibration.z_rms)
    counts = ("n_outside", "n_unknown", "n_silent")
    assert [getattr(found, n) for n in counts] == [getattr(whole, n) for n in counts]
    assert found.verdicts[0].met == whole.verdicts[0].met


def test_what_memory_refuses_blocks_refuse_too(rasters: tuple[Path, Path], tmp_path: Path) -> None:
    other = Dem.read(rasters[1])
    Dem(other.elevation, other.transform, other.crs, "NAVD88 height").write(tmp_path / "datum.tif")
    with pytest.raises(InputError, match="vertical datums"):
        scores.score_files(rasters[0], tmp_path / "datum.tif")
    Dem(other.elevation, other.transform @ other.transform.translation(9000, 0), other.crs).write(
        tmp_path / "far.tif"
    )
    with pytest.raises(InputError, match="nothing to score"):
        scores.score_files(rasters[0], tmp_path / "far.tif")
    content = rasters[1].read_bytes()
    (tmp_path / "cut.tif").write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match="damaged"):
        scores.score_files(rasters[0], tmp_path / "cut.tif")
    upward = rasterio.Affine(2.0, 0.0, 5.0, 0.0, 2.0, 5.0)
    profile = {"height": 9, "width": 9, "count": 1, "dtype": "float32", "crs": UTM, "transform": upward}
    with rasterio.open(tmp_path / "up.tif", "w", driver="GTiff", **profile) as target:
        target.write(np.ones((9, 9), dtype=np.float32), 1)
    with pytest.raises(InputError, match="northern"):
        scores.score_files(tmp_path / "up.tif", rasters[1])


def test_errors_far_from_the_first_blocks_keep_their_quantiles() -> None:
    rng = np.random.default_rng(6)
    sketch = ErrorSketch()
    parts = [rng.normal(100.0, 0.05, 4000), rng.normal(100.2, 0.05, 12_000), rng.normal(-3.0, 5.0, 500)]
    for part in parts:
        sketch.add(part)
    exact = survey.scoring.ErrorStatistics.of(np.concatenate(parts))
    found = sketch.statistics()
    assert found.median_m == pytest.approx(exact.median_m, abs=1e-4)
    assert found.nmad_m == pytest.approx(exact.nmad_m, abs=1e-3)
    assert found.p95_m == pytest.approx(exact.p95_m, abs=1e-4)
    assert found.kurtosis == pytest.approx(exact.kurtosis, rel=1e-6)
