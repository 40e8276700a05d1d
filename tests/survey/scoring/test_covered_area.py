"""The covered share is that of the area, not of the raster, and no class is stated for a map with gaps."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import survey
from firnline.cli.main import app
from survey import Dem, Grid, SurveyArea
from survey.reporting.page import verdict_sentence
from survey.scoring import Checkpoints, Score, compare, score_at
from survey.scoring.scores import score_files

UTM = "EPSG:32608"
WIDE = Grid((0.0, 0.0, 1000.0, 400.0), 10.0, UTM)
# 945 of the 1000 m of the area's width.
NARROW = Grid((0.0, 0.0, 940.0, 400.0), 10.0, UTM)
AREA = SurveyArea.rectangle((0.0, 0.0, 1000.0, 400.0), UTM)
FLAT = Dem.on(WIDE, np.zeros(WIDE.shape))


def _map(grid: Grid) -> Dem:
    return Dem.on(grid, np.broadcast_to(0.005 + 1e-5 * grid.x, grid.shape))


def test_ground_beyond_the_raster_is_not_covered() -> None:
    result = survey.score(_map(NARROW), truth=FLAT, area=AREA)
    assert result.covered_share == pytest.approx(0.945, abs=0.002)
    assert not any(verdict.met for verdict in result.verdicts)
    assert result.verdicts[0].is_withheld
    assert "covers 94.7 % of the area" in result.verdicts[0].note
    assert "No class is stated" in verdict_sentence(result.verdicts)


def test_a_map_of_the_area_has_a_class() -> None:
    result = survey.score(_map(WIDE), truth=FLAT, area=AREA)
    assert result.covered_share == 1.0
    assert all(verdict.met for verdict in result.verdicts)


def test_a_raster_that_ends_where_the_reference_ends_does_not_cover_the_area_either() -> None:
    result = survey.score(_map(NARROW), truth=_map(NARROW), area=AREA)
    assert result.covered_share == pytest.approx(0.945, abs=0.002)


def test_a_gap_without_a_reference_is_not_covered() -> None:
    holes = _map(WIDE).elevation.copy()
    holes[:, :20] = np.nan
    result = survey.score(Dem.on(WIDE, holes), truth=Dem.on(WIDE, holes), area=AREA)
    assert result.n_silent == 20 * 41
    assert result.covered_share == pytest.approx(1.0 - 20 / 101)


def test_without_an_area_gaps_that_the_reference_shares_do_not_count() -> None:
    holes = _map(WIDE).elevation.copy()
    holes[:, :20] = np.nan
    result = survey.score(Dem.on(WIDE, holes), truth=Dem.on(WIDE, holes))
    assert (result.n_silent, result.n_outside, result.covered_share) == (0, 20 * 41, 1.0)


def test_mapped_ground_without_a_reference_is_covered() -> None:
    result = survey.score(_map(WIDE), truth=_map(NARROW), area=AREA)
    assert result.covered_share == 1.0
    assert result.n_unknown > 0


def test_a_large_error_is_not_met_rather_than_withheld() -> None:
    rough = Dem.on(NARROW, np.full(NARROW.shape, 2.0))
    verdict = survey.score(rough, truth=FLAT, area=AREA).verdicts[0]
    assert (verdict.met, verdict.is_withheld) == (False, False)


def test_blocks_count_the_area_too(tmp_path: Path) -> None:
    _map(NARROW).write(tmp_path / "map.tif")
    FLAT.write(tmp_path / "truth.tif")
    found = score_files(tmp_path / "map.tif", tmp_path / "truth.tif", AREA)
    whole = survey.score(_map(NARROW), truth=FLAT, area=AREA)
    assert (found.n_silent, found.covered_share) == (whole.n_silent, whole.covered_share)
    assert not any(verdict.met for verdict in found.verdicts)


def test_a_score_with_gaps_survives_json() -> None:
    first = survey.score(_map(NARROW), truth=FLAT, area=AREA)
    back = Score.from_dict(json.loads(json.dumps(first.to_dict())))
    assert (back.verdicts, back.covered_share) == (first.verdicts, first.covered_share)


def test_checkpoints_give_no_class_to_a_map_with_gaps() -> None:
    rng = np.random.default_rng(3)
    xyz = np.column_stack([rng.uniform(0.0, 900.0, 40), rng.uniform(0.0, 400.0, 40), np.zeros(40)])
    points = Checkpoints(xyz, 0.005, UTM)
    for grid, outcome in ((WIDE, "met"), (NARROW, "not assessed to the standard")):
        finding = score_at(compare(_map(grid), points, AREA), class_m=0.1).assessments[0]
        assert finding.outcome == outcome
        assert ("the map covers 94.7%" in finding.sentence) == (outcome != "met")


def test_the_command_says_the_share(tmp_path: Path) -> None:
    _map(NARROW).write(tmp_path / "map.tif")
    FLAT.write(tmp_path / "truth.tif")
    AREA.write(tmp_path / "area.gpkg")
    args = ["score", str(tmp_path / "map.tif"), "--truth", str(tmp_path / "truth.tif")]
    done = CliRunner().invoke(app, [*args, "--area", str(tmp_path / "area.gpkg")])
    assert done.exit_code == 0, done.output
    assert "No class is stated: the map covers 94.7 % of the area" in done.stdout
    assert "cm class" not in done.stdout
