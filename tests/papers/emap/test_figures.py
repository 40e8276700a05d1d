"""The EMap experiment: its scanner, its scores, and its studies."""

from pathlib import Path

import numpy as np
import pytest

from papers.emap.world import RasterHeights, beams, utilities, weighted_mse_cm2
from papers.studies import study
from survey.core.errors import InputError


def test_rays_meet_a_slope_where_geometry_says() -> None:
    field = RasterHeights.of(lambda xy: 0.2 * xy[:, 0], (-12.0, -12.0, 12.0, 12.0))
    rays = np.array([[0.6, 0.0, -0.8], [0.0, 0.6, -0.8], [-0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])
    # 2 - 0.8 t = 0.2 · 0.6 t, and the like; the last ray goes up.
    expected = [2.0 / 0.92, 2.5, 2.0 / 0.68, np.inf]
    np.testing.assert_allclose(field.hits(np.array([0.0, 0.0, 2.0]), rays, 10.0), expected, atol=1e-5)


def test_the_scanner_has_its_beams() -> None:
    directions = beams()
    assert directions.shape == (512 * 64, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    np.testing.assert_allclose(np.degrees(np.arcsin(directions[:, 2].max())), 22.5)


def test_the_utilities_reach_their_limits() -> None:
    F = utilities(np.array([[0.0, 0.0], [6.0, 0.0], [50.0, 0.0]]))
    # The normal distribution 4 deviations from its middle: 3e-5.
    np.testing.assert_allclose(F["CDF"], [1.0, 0.0228, 0.0], atol=1e-3)
    np.testing.assert_allclose(F["Gaussian"], [0.0, 1.0, 0.0], atol=1e-7)
    assert F["Nearest"].tolist() == [1.0, 0.0, 0.0]
    assert F["Raw"].tolist() == [1.0, 1.0, 1.0]


def test_a_mean_over_no_node_is_refused() -> None:
    with pytest.raises(InputError, match="nothing to average"):
        weighted_mse_cm2(np.ones(3), np.zeros(3))


def test_the_hits_study_writes_its_products(tmp_path: Path) -> None:
    calls: list[tuple[str, int, int]] = []
    study("emap-fig2")(tmp_path, quick=True, progress=lambda *what: calls.append(what))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["hits.csv", "hits.png"]
    assert calls[-1] == ("scans", 5, 5)
