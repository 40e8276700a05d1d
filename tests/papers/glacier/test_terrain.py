"""The glacier paper's terrain figures: what their tables say is what the paper says, or why not."""

import csv

import numpy as np
import pytest

from papers.studies import study
from survey import Grid, SurfacePoints
from survey.core.streams import stream
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.terrain import random_dem, satellite_copy


def _made(name, folder):
    study(name)(folder, quick=True, progress=lambda *_: None)


def _rows(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_tables_hold_the_papers_nine_limits(tmp_path):
    _made("glacier-tables", tmp_path)
    limits = sorted({float(row["limiting_rmse_m"]) for row in _rows(tmp_path / "map_classes.csv")})
    assert limits == pytest.approx([0.0508, 0.1016, 0.1524, 0.2032, 0.3048, 0.4572])


def test_around_one_line_a_mesh_ends_at_the_hull_and_a_process_with_the_satellite_errs_least():
    grid = Grid((0.0, 0.0, 300.0, 300.0), 10.0, "EPSG:32608")
    ground = random_dem("squared-exponential", grid, stream(1), 25.0, length_scale_m=80.0)
    satellite = satellite_copy(ground, rng=stream(2), cell_m=50.0, sigma_m=1.0)
    along, aside = np.linspace(40.0, 260.0, 120), stream(3).normal(0.0, 6.0, (120, 2))
    xy = np.column_stack([along, along]) + aside
    points = SurfacePoints(np.column_stack([xy, ground.at(xy)]), sigma_m=0.1, crs=grid.crs)
    kernel = GaussianProcessConfig(fit=False, variance_m2=25.0, length_scale_m=60.0, nugget_m=0.1)
    maps = (
        reconstruct(points, grid, method="tin"),
        reconstruct(points, grid, config=kernel),
        reconstruct(points, grid, satellite, config=kernel),
    )
    mesh, process, around = (found.mean.elevation - ground.elevation for found in maps)
    assert 0.0 < np.isfinite(mesh).mean() < 0.5
    assert np.isfinite([process, around]).all()
    assert np.sqrt(np.mean(around**2)) < np.sqrt(np.mean(process**2))


@pytest.mark.exhaustive
def test_a_mesh_ends_at_the_hull_and_a_process_with_the_satellite_errs_least(tmp_path):
    _made("glacier-fig5", tmp_path)
    mesh, process, around = _rows(tmp_path / "reconstructions.csv")
    assert 0.0 < float(mesh["share_mapped"]) < 0.5
    assert float(process["share_mapped"]) == float(around["share_mapped"]) == 1.0
    assert float(around["rmse_m"]) < float(process["rmse_m"])
    assert {path.name for path in tmp_path.iterdir()} >= {"reconstructions.png", "errors.png"}


def test_four_swaths_visit_four_rows_of_cells_and_a_link_of_two(tmp_path):
    _made("glacier-fig8", tmp_path)
    (row,) = _rows(tmp_path / "coverage.csv")
    assert float(row["driven_m"]) == 4 * 600 + 3 * 150
    assert float(row["beta"]) == pytest.approx(0.0, abs=1e-9)
