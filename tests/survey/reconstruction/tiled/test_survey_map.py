"""A made survey of two strips, mapped in tiles."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from survey.core.errors import ConfigError, InputError
from survey.core.executors import run_all
from survey.data.dem import Dem
from survey.reconstruction.tiled.job import Control, TiledConfig, tiled_job
from survey.reconstruction.tiled.survey_map import map_in_tiles
from survey.reconstruction.tiled.tile_map import TiledResult
from survey.scoring.scores import score_files
from tests.survey.reconstruction.tiled.conftest import OFFSET_M, ground

CONFIG = TiledConfig(tile_cells=80, halo_cells=40, n_draws=8, withheld_share=0.05)
SERIAL: Any = partial(run_all, engine="serial")


def control() -> Control:
    xy = np.array([[20.0, 30.0], [40.0, 90.0], [150.0, 40.0], [170.0, 100.0]])
    return Control(np.column_stack([xy, ground(*xy.T)]), np.full(4, 0.01))


def mapped(files: list[Path], out: Path, config: TiledConfig = CONFIG, run: Any = SERIAL) -> TiledResult:
    out.mkdir(exist_ok=True)
    return map_in_tiles(tiled_job(files, out, config, control=control()), run)


@pytest.fixture(scope="module")
def made(laz_files: list[Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[TiledResult, Path]:
    out = tmp_path_factory.mktemp("map")
    return mapped(laz_files, out), out


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def test_the_map_is_the_ground_within_its_standard_deviation(made: tuple[TiledResult, Path]) -> None:
    height, std = (Dem.read(made[1] / "dem.vrt", band=band) for band in (1, 2))
    error = height.elevation - ground(*height.xy.T).reshape(height.shape)
    assert np.sqrt(np.nanmean(error**2)) < 0.03
    assert 0.9 < np.nanmean(np.abs(error) < 1.96 * std.elevation) <= 1.0


def test_the_offset_between_the_strips_is_found(made: tuple[TiledResult, Path]) -> None:
    strips = made[0].facts["diagnostics"]["strips"]
    for name, true_m in (("11", OFFSET_M), ("12", 0.0)):
        assert abs(strips[name]["offset_m"] - true_m) < 3.0 * strips[name]["offset_m_sigma"] < 0.1


def test_withheld_cells_test_the_map(made: tuple[TiledResult, Path]) -> None:
    test = made[0].test
    assert test.n > 500
    assert 0.9 < test.coverage_95 <= 1.0
    assert Dem.read(made[1] / "coverage.tif").shape == (4, 7)


def test_no_work_is_left_behind(made: tuple[TiledResult, Path]) -> None:
    assert sorted(file.name for file in made[1].iterdir()) == [
        *("coverage.tif", "dem.vrt", "reconstruction.json", "support.vrt", "tiles")
    ]


def test_tiles_meet_without_seams(
    made: tuple[TiledResult, Path], laz_files: list[Path], tmp_path: Path
) -> None:
    mapped(laz_files, tmp_path / "one", CONFIG.model_copy(update={"tile_cells": 200}))
    for band, bar in ((1, 1e-3), (2, None)):
        tiled, one = (Dem.read(f / "dem.vrt", band=band).elevation for f in (made[1], tmp_path / "one"))
        edges = np.zeros(tiled.shape, bool)
        edges[:, 78:82], edges[-82:-78] = True, True
        differences = np.abs(tiled - one)[edges & np.isfinite(tiled + one)]
        assert differences.mean() < (bar or 0.02 * np.nanmean(one))


class KilledError(Exception):
    """Stands for the end of the process."""


def killed_after(n: int) -> Any:
    """Return a runner that ends after so many pieces of all stages."""
    left = [n]

    def run(work: Callable[[Any], Any], pieces: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        for piece, result in run_all(work, list(pieces), engine="serial"):
            if left[0] == 0:
                raise KilledError
            left[0] -= 1
            yield piece, result

    return run


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 4, 12, 16])
def test_a_killed_run_goes_on_to_the_same_bytes(
    made: tuple[TiledResult, Path], laz_files: list[Path], tmp_path: Path, n: int
) -> None:
    with pytest.raises(KilledError):
        mapped(laz_files, tmp_path / "map", run=killed_after(n))
    mapped(laz_files, tmp_path / "map")
    assert files_of(tmp_path / "map") == files_of(made[1])


def test_work_of_other_settings_is_not_continued(laz_files: list[Path], tmp_path: Path) -> None:
    with pytest.raises(KilledError):
        mapped(laz_files, tmp_path / "map", run=killed_after(1))
    with pytest.raises(InputError, match="another map"):
        mapped(laz_files, tmp_path / "map", CONFIG.model_copy(update={"n_draws": 9}))


def test_a_full_disk_is_refused_before_work_starts(
    laz_files: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage._replace(free=1000))
    with pytest.raises(InputError, match="of disk for"):
        mapped(laz_files, tmp_path / "map")


def test_blocks_divide_tiles() -> None:
    with pytest.raises(ConfigError, match="multiple"):
        TiledConfig(tile_cells=90)


def test_a_map_in_tiles_is_scored_in_blocks(made: tuple[TiledResult, Path], tmp_path: Path) -> None:
    height = Dem.read(made[1] / "dem.vrt")
    truth = Dem.on(height.grid(), ground(*height.xy.T).reshape(height.shape))
    truth.write(tmp_path / "truth.tif")
    found = score_files(made[1] / "dem.vrt", tmp_path / "truth.tif").to_dict()["elevation"]
    error = height.elevation - truth.elevation
    assert found["rmse_m"] == pytest.approx(np.sqrt(np.nanmean(error**2)), rel=1e-3)
