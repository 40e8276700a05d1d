"""Table of scores."""

import numpy as np
import pytest

from survey import Dem, Grid, SurveyArea
from survey.reporting.page import score_rows
from survey.scoring import score


@pytest.fixture(scope="module")
def table():
    grid = Grid((0.0, 0.0, 200.0, 200.0), 5.0, "EPSG:32608")
    truth = np.add.outer(0.1 * grid.y, 0.05 * grid.x)
    error = np.random.default_rng(3).normal(0.05, 0.2, grid.shape)
    area = SurveyArea.rectangle((0.0, 0.0, 200.0, 200.0), "EPSG:32608")
    return score_rows(score(Dem.on(grid, truth + error), truth=Dem.on(grid, truth), area=area))


def test_every_group_has_rows_with_a_name_a_value_and_a_meaning(table):
    assert list(table) == ["Elevation", "Uncertainty", "Coverage", "Nodes of the map"]
    assert all(row.name and row.value and row.meaning for rows in table.values() for row in rows)


def test_a_map_without_a_claim_has_dashes_for_its_uncertainty(table):
    assert [row.value for row in table["Uncertainty"]] == ["–", "–"]


def test_the_class_of_the_relative_error_is_by_the_newest_edition(table):
    (row,) = (row for row in table["Elevation"] if row.name == "Standard deviation")
    assert row.meaning.endswith("; 19.7 cm class")
