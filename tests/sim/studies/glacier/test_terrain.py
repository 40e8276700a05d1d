"""The glacier paper's terrain figures: what their tables say is what the paper says, or why not."""

import csv

import pytest

from sim.studies import study


def _made(name, folder):
    study(name)(folder, quick=True, progress=lambda *_: None)


def _rows(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_tables_hold_the_papers_nine_limits(tmp_path):
    _made("glacier-tables", tmp_path)
    limits = sorted({float(row["limiting_rmse_m"]) for row in _rows(tmp_path / "map_classes.csv")})
    assert limits == pytest.approx([0.0508, 0.1016, 0.1524, 0.2032, 0.3048, 0.4572])


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
