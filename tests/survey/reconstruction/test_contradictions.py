"""Heights that contradict one another at one place are named, and no map states less than their scatter there."""

from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from survey.data import Dem, Grid, SurfacePoints
from survey.io.point_files import write_point_table
from survey.io.point_table import PointTable
from survey.reconstruction import reconstruct
from survey.reconstruction.mapping import map_scans
from survey.reconstruction.method import ScanSettings
from survey.reconstruction.observations import Contradictions, with_scatter
from survey.reconstruction.registry import METHODS, method_named
from survey.reconstruction.tiled.job import TiledConfig, tiled_job
from survey.reconstruction.tiled.survey_map import map_in_tiles

CRS = "EPSG:32608"
GRID = Grid((0.0, 0.0, 60.0, 60.0), 4.0, CRS)
AGAIN = np.array([11, 47, 80])


def ground(offset_m: float = 2.0, sigma_m: float = 0.05, seed: int = 1) -> SurfacePoints:
    """Return points of gentle ground, of which three were measured again with an offset."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(1.0, 59.0, (120, 2))
    z = 300.0 + 0.05 * xy[:, 0] + rng.normal(0.0, 0.02, 120)
    again = np.column_stack([xy[AGAIN], z[AGAIN] + offset_m])
    xyz = np.concatenate([np.column_stack([xy, z]), again])
    return SurfacePoints(xyz, sigma_m=sigma_m, crs=CRS, origins=np.tile([30.0, 30.0, 330.0], (len(xyz), 1)))


POINT_METHODS = [name for name, method in METHODS.items() if not method.needs_path]


@pytest.mark.parametrize("method", POINT_METHODS)
@pytest.mark.parametrize(("offset_m", "sigma_m"), [(2.0, 0.05), (0.5, 1e-4)])
def test_no_map_states_less_than_the_scatter(
    method: str, offset_m: float, sigma_m: float, caplog: Any
) -> None:
    points = ground(offset_m, sigma_m)
    result = reconstruct(points, GRID, method=method)
    (named,) = result.diagnostics["contradictions"]
    first = points.xy[AGAIN[0]]
    assert named["n"] == 3
    assert [named["x_m"][0], named["y_m"][0]] == pytest.approx(first.tolist())
    scatter_m = offset_m / np.sqrt(2.0)
    assert (
        f"3 places hold heights that contradict one another: the first, at {first[0]:.2f}, {first[1]:.2f}"
        in caplog.text
    )
    assert f"a scatter of {scatter_m:.2f} m" in caplog.text
    stated = result.std.at(points.xy[AGAIN])
    assert (stated[np.isfinite(stated)] >= 0.999 * scatter_m).all()


@pytest.mark.parametrize("method", [name for name, method in METHODS.items() if method.begin is not None])
def test_scans_that_contradict_one_another_are_named(method: str) -> None:
    points = ground()
    parts = [points.select(np.arange(120)), points.select(np.arange(120, 123))]
    made = map_scans(iter(parts), method_named(method), ScanSettings(4.0), grid=GRID).reconstruction
    assert made.diagnostics["contradictions"][0]["n"] == 3
    stated = made.std.at(points.xy[AGAIN])
    assert (stated[np.isfinite(stated)] >= 1.41).all()


def test_measurements_that_agree_within_their_errors_stay_as_they_are() -> None:
    points = ground(offset_m=0.05)
    same, found = with_scatter(points)
    assert found is None
    assert same is points


def test_many_small_contradictions_count_together() -> None:
    rng = np.random.default_rng(2)
    xy = np.repeat(rng.uniform(0.0, 50.0, (60, 2)), 2, axis=0)
    z = np.tile([0.0, 0.25], 60)
    found = Contradictions.among(xy, z, np.full(120, 0.1**2))
    assert found is not None
    assert len(found.n) == 60
    assert Contradictions.among(xy[:2], z[:2], np.full(2, 0.1**2)) is None


def test_covariances_grow_by_the_scatter_alone() -> None:
    points = ground()
    covariance = np.tile(np.diag([0.01, 0.02, 0.0025]), (len(points), 1, 1))
    with_covariance = SurfacePoints(points.xyz, covariance, crs=CRS)
    raised, found = with_scatter(with_covariance)
    assert found is not None
    assert raised.sigma_z[AGAIN] == pytest.approx([2.0] * 3)
    assert raised.covariance is not None
    assert raised.covariance[:, :2, :2] == pytest.approx(covariance[:, :2, :2])
    assert raised.sigma_z[0] == 0.05


def cloud(file: Path, shift_m: float = 0.0, n_again: int = 0, offset_m: float = 0.0) -> Path:
    """Write a cloud of 20,000 points, the first of them again with an offset."""
    rng = np.random.default_rng(3)
    x, y = np.round(rng.uniform(0.0, 100.0, (2, 20_000)), 3) + 5e5
    z = 300.0 + 0.02 * (x - 5e5) + rng.normal(0.0, 0.03, len(x)) + shift_m
    columns = {"x_m": x, "y_m": y, "z_m": z}
    again = {name: np.concatenate([c, c[:n_again]]) for name, c in columns.items()}
    again["z_m"][len(x) :] += offset_m
    write_point_table(file, PointTable(again, pyproj.CRS(CRS)))
    return file


def tiled(folder: Path, *files: Path) -> dict[str, Any]:
    job = tiled_job(list(files), folder / "map", TiledConfig(tile_cells=200))
    return map_in_tiles(job, lambda work, pieces: [(piece, work(piece)) for piece in pieces]).facts[
        "diagnostics"
    ]


def test_a_map_in_tiles_names_contradictions_and_states_their_scatter(tmp_path: Path) -> None:
    file = cloud(tmp_path / "a.laz", n_again=20, offset_m=2.0)
    assert tiled(tmp_path, file)["contradictions"][0]["n"] == 20
    std = Dem.read(tmp_path / "map" / "dem.vrt", band=2)
    rng = np.random.default_rng(3)
    xy = np.round(rng.uniform(0.0, 100.0, (2, 20_000)), 3).T[:20] + 5e5
    assert (std.at(xy[np.isfinite(std.at(xy))]) >= 1.41).all()


def test_a_map_in_tiles_that_fails_its_own_check_says_so(tmp_path: Path) -> None:
    files = cloud(tmp_path / "a.laz"), cloud(tmp_path / "b.laz", shift_m=400.0)
    (said,) = tiled(tmp_path, *files)["warnings"]
    assert said.startswith("the map fails its own check: ")
    assert "name the unit with --units" in said
