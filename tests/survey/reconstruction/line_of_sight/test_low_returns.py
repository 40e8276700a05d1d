"""Isolated low returns are left out before a map is built on them; pits and crevasses stay."""

from collections.abc import Callable

import numpy as np
import pytest

from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import reconstruct
from survey.reconstruction.line_of_sight.returns import isolated_low
from survey.reconstruction.mapping import map_scans
from survey.reconstruction.method import ScanSettings
from survey.reconstruction.registry import METHODS
from survey.reconstruction.terrain_map import Reconstruction

CRS = "EPSG:32608"
GRID = Grid((2.0, 2.0, 28.0, 28.0), 0.5, CRS)


def hill(xy: np.ndarray) -> np.ndarray:
    heights: np.ndarray = 0.4 * np.sin(xy[:, 0] / 4.0) + 0.3 * np.cos(xy[:, 1] / 5.0)
    return heights


def scan(n: int = 12_000) -> np.ndarray:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0.0, 30.0, (n, 2))
    return np.column_stack([xy, hill(xy) + 0.02 * rng.standard_normal(n)])


def haunted(xyz: np.ndarray, n: int = 14, size: int = 1) -> np.ndarray:
    """Scatter clusters of returns 10 m below the ground."""
    rng = np.random.default_rng(1)
    spread = np.stack(np.meshgrid(np.arange(4.0, 28.0, 6.0), np.arange(4.0, 28.0, 6.0)), axis=-1).reshape(
        -1, 2
    )
    centre = np.repeat(spread[:n] + rng.uniform(-1.0, 1.0, (n, 2)), size, axis=0)
    xy = centre + rng.uniform(-0.2, 0.2, centre.shape) * (size > 1)
    low = np.column_stack([xy, hill(xy) - 10.0 + 0.1 * rng.standard_normal(len(xy))])
    return np.vstack([xyz, low])


def points(xyz: np.ndarray) -> SurfacePoints:
    return SurfacePoints(xyz, sigma_m=0.02, origins=np.tile([15.0, 15.0, 12.0], (len(xyz), 1)), crs=CRS)


def rmse_and_coverage(result: Reconstruction) -> tuple[float, float]:
    error = result.mean.elevation - hill(GRID.xy).reshape(GRID.shape)
    return float(np.sqrt(np.nanmean(error**2))), float(np.isfinite(error).mean())


@pytest.mark.parametrize("size", [1, 2, 3])
def test_scattered_and_paired_low_returns_are_found_and_nothing_else(size: int) -> None:
    xyz = haunted(scan(), size=size)
    low = isolated_low(xyz)
    assert low[12_000:].all()
    assert not low[:12_000].any()


def test_a_pit_with_several_returns_stays() -> None:
    rng = np.random.default_rng(2)
    floor = np.column_stack([rng.uniform(14.5, 15.5, (12, 2)), np.full(12, -6.0)])
    xyz = scan()
    inside = (np.abs(xyz[:, :2] - 15.0) < 0.5).all(axis=1)
    assert not isolated_low(np.vstack([xyz[~inside], floor])).any()


def test_a_crevasse_stays_with_its_walls() -> None:
    rng = np.random.default_rng(3)
    xyz = scan()
    inside = np.abs(xyz[:, 0] - 15.0) < 0.4
    xyz[inside, 2] -= rng.uniform(0.0, 8.0, int(inside.sum()))
    assert isolated_low(xyz)[inside].mean() < 0.02


def test_a_steep_slope_and_few_points_stay() -> None:
    xyz = scan()
    xyz[:, 2] += 1.5 * xyz[:, 0]
    assert not isolated_low(xyz).any()
    assert not isolated_low(haunted(scan(10), 1)).any()


def test_far_sparse_returns_are_judged_by_the_neighbours_there_are() -> None:
    rng = np.random.default_rng(4)
    xy = rng.uniform(0.0, 300.0, (400, 2))
    xyz = np.column_stack([xy, 0.02 * xy[:, 0]])
    xyz[[5, 60], 2] -= 12.0
    np.testing.assert_array_equal(np.flatnonzero(isolated_low(xyz)), [5, 60])


def scanned(name: str, *, rays: bool) -> Callable[[np.ndarray], Reconstruction]:
    def mapped(xyz: np.ndarray) -> Reconstruction:
        return map_scans([points(xyz)], METHODS[name], ScanSettings(0.5, rays=rays), grid=GRID).reconstruction

    return mapped


def mapped_by_gp(xyz: np.ndarray) -> Reconstruction:
    return reconstruct(points(xyz).select(np.arange(len(xyz)) >= 11_000), GRID, method="tin", rays=True)


@pytest.mark.parametrize(
    "mapped",
    [
        pytest.param(scanned("field", rays=True), id="field with rays"),
        pytest.param(scanned("field", rays=False), id="field"),
        pytest.param(scanned("emap", rays=False), id="emap"),
        pytest.param(scanned("carving", rays=True), id="carving"),
        pytest.param(mapped_by_gp, id="points with rays"),
    ],
)
def test_low_returns_leave_the_map_as_it_is(mapped: Callable[[np.ndarray], Reconstruction]) -> None:
    clean = mapped(scan())
    rmse, coverage = rmse_and_coverage(clean)
    assert clean.diagnostics["n_low_returns"] == 0
    for size in (1, 3):
        other = mapped(haunted(scan(), size=size))
        rmse_haunted, coverage_haunted = rmse_and_coverage(other)
        assert rmse_haunted < 1.05 * rmse
        assert coverage_haunted == coverage
        assert other.diagnostics["n_low_returns"] == 14 * size
