"""Triangles are taken where points left out show them to be as good, with a deviation that holds the relief between points."""

import json
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.core import FloatArray
from survey.data.area import SurveyArea
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import method_choice
from survey.reconstruction.method_choice import compare_methods
from survey.reconstruction.terrain_map import METHOD_CHOICE, Reconstruction

N, SIDE_M, SIGMA_M = 4000, 300, 0.01
GRID = Grid((0.0, 0.0, 296.0, 296.0), 4.0)
CRS_32608 = CRS.from_epsg(32608)


def rough() -> FloatArray:
    """Return heights (300, 300) of steps that are independent of one another at all scales, 1 m each [m]."""
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(SIDE_M), np.fft.rfftfreq(SIDE_M), indexing="ij"))
    k[0, 0] = np.inf
    white = np.fft.rfft2(np.random.default_rng(1).standard_normal((SIDE_M, SIDE_M)))
    heights: FloatArray = np.fft.irfft2(k**-1.5 * white, (SIDE_M, SIDE_M))
    heights /= heights.std()
    return heights


def measured(heights: FloatArray, n: int = N, stated_m: float = SIGMA_M) -> SurfacePoints:
    """Return points at n of the cells."""
    rng = np.random.default_rng(2)
    cells = rng.permutation(heights.size)[:n]
    z = heights.ravel()[cells] + SIGMA_M * rng.standard_normal(n)
    return SurfacePoints(
        np.column_stack([cells % SIDE_M, cells // SIDE_M, z]), sigma_m=stated_m, crs=CRS_32608
    )


def waves() -> FloatArray:
    x, y = np.meshgrid(np.arange(SIDE_M), np.arange(SIDE_M))
    return np.sin(x / 20.0) + np.cos(y / 20.0)


@pytest.fixture
def lenient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Count errors of up to 10 % more as equal: on rough ground triangles err by 5 % more."""
    monkeypatch.setattr(method_choice, "_AS_GOOD", 1.1)


def test_smooth_ground_is_left_to_the_gaussian_process() -> None:
    choice = compare_methods(measured(waves()), GRID)
    assert choice is not None
    assert choice.method == "gp"
    assert choice.tin_m > 2.0 * choice.gp_m


def test_points_better_than_stated_are_left_to_the_method_that_averages_them() -> None:
    choice = compare_methods(measured(waves(), stated_m=0.5), GRID)
    assert choice is not None
    assert (choice.method, choice.tin_m, choice.gp_m) == ("gp", 0.0, 0.0)
    assert "neither method errs by more than the stated standard deviations" in choice.sentence
    assert "400 points left out" in choice.sentence


def test_few_points_are_not_compared() -> None:
    assert compare_methods(measured(rough(), 300), GRID) is None


@pytest.mark.usefixtures("lenient")
def test_triangles_stand_for_no_ground_far_from_points() -> None:
    choice = compare_methods(measured(rough()), GRID)
    assert choice is not None
    assert choice.method == "tin"
    beyond = Grid((0.0, 0.0, 596.0, 296.0), 4.0)
    far = compare_methods(measured(rough()), beyond)
    assert far is not None
    assert far.method == "gp"
    area = SurveyArea.rectangle((0.0, 0.0, 298.0, 298.0), CRS_32608)
    within = compare_methods(measured(rough()), beyond, area)
    assert within is not None
    assert within.method == "tin"


@pytest.mark.usefixtures("lenient")
def test_the_command_takes_triangles_with_the_relief_between_points(tmp_path: Path) -> None:
    heights = rough()
    measured(heights).write(tmp_path / "points.gpkg")
    source, made = str(tmp_path / "points.gpkg"), tmp_path / "map"
    result = CliRunner().invoke(app, ["reconstruct", source, "--grid", "4", "-o", str(made)])
    assert result.exit_code == 0, result.output
    assert "nodes by tin" in result.output
    assert "m; --method gp maps by the Gaussian process" in result.output
    found = Reconstruction.read(made)
    assert (
        json.loads((made / "reconstruction.json").read_text())["diagnostics"][METHOD_CHOICE]["method"]
        == "tin"
    )
    column, row = np.round(found.mean.xy).astype(int).T
    inside = (column < SIDE_M) & (row < SIDE_M)
    error = found.mean.elevation.ravel()[inside] - heights[row[inside], column[inside]]
    covered = np.abs(error) < 1.96 * found.std.elevation.ravel()[inside]
    assert np.isfinite(error).all()
    assert 0.92 < covered.mean() < 0.98


@pytest.mark.usefixtures("lenient")
def test_a_stated_method_is_taken(tmp_path: Path) -> None:
    measured(rough()).write(tmp_path / "points.gpkg")
    source, out = str(tmp_path / "points.gpkg"), str(tmp_path / "map")
    kernel = ("fit=false", "variance_m2=1.0", "length_scale_m=20")
    stated = [word for each in kernel for word in ("--set", f"reconstruction.gp.{each}")]
    for words in (["--method", "tin"], stated):
        result = CliRunner().invoke(app, ["reconstruct", source, "--grid", "8", "-o", out, "--force", *words])
        assert result.exit_code == 0, result.output
        assert "points left out triangles" not in result.output
