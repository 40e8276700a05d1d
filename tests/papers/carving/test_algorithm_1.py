"""Algorithm 1 of the carving paper as printed, on small worlds with known answers."""

import csv
from pathlib import Path

import numpy as np
import pytest

from papers.carving.comparison import LiteralCarving
from papers.studies import study
from survey import InputError, SurfacePoints
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.descent import wu_kernel

CRS = "EPSG:32608"


def point(z: float, sensor: tuple[float, float, float]) -> SurfacePoints:
    return SurfacePoints(np.array([[20.0, 20.0, z]]), sigma_m=0.02, origins=np.array([sensor]), crs=CRS)


def test_one_point_gives_one_basis_of_weight_rate_times_residual() -> None:
    config = SpaceCarvingConfig(n_epochs=1, prior_m=1.0, rate=0.5, decay=0.0)
    model = LiteralCarving(config).fit(point(0.0, (20.0, 20.0, 5.0)))
    places = np.array([[20.0, 20.0], [22.0, 20.0], [26.0, 20.0]])
    expected = 1.0 - 0.5 * wu_kernel(np.array([0.0, 2.0, 6.0]), 5.0)
    np.testing.assert_allclose(model.predict(places), expected)
    assert model.n_bases_ == 1


def test_a_line_of_sight_presses_with_the_same_falling_rate_where_it_is_deepest() -> None:
    config = SpaceCarvingConfig(n_epochs=1, prior_m=3.0, rate=0.5, decay=0.0, first_length_m=1.0)
    model = LiteralCarving(config, is_rate_strict=True).fit(point(0.0, (30.0, 20.0, 2.0)))
    assert model.n_bases_ == 2
    # The point takes half of its 3 m; the line climbs by 0.2 m a metre and is searched at steps of 0.2 m.
    along = 0.2 * np.arange(1, 51)
    depth = 3.0 - 1.5 * wu_kernel(along, 1.0) - 0.2 * along
    worst = int(np.argmax(depth))
    pressed = 0.5 / np.sqrt(2.0) * depth[worst]
    at = np.array([[20.0 + along[worst], 20.0]])
    assert model.predict(at)[0] == pytest.approx(0.2 * along[worst] + depth[worst] - pressed)


def test_passes_meet_a_plane_that_is_seen_from_above() -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.0, 8.0, (600, 2))
    xyz = np.column_stack([xy, 0.2 * xy[:, 0] + 0.02 * rng.standard_normal(600)])
    points = SurfacePoints(xyz, sigma_m=0.02, origins=np.tile([4.0, 4.0, 9.0], (600, 1)), crs=CRS)
    model = LiteralCarving(SpaceCarvingConfig(n_epochs=6)).fit(points)
    inside = np.column_stack(
        [axis.ravel() for axis in np.meshgrid(np.linspace(1, 7, 9), np.linspace(1, 7, 9))]
    )
    assert np.abs(model.predict(inside) - 0.2 * inside[:, 0]).max() < 0.1


def test_points_without_lines_of_sight_are_refused() -> None:
    with pytest.raises(InputError):
        LiteralCarving(SpaceCarvingConfig()).fit(SurfacePoints(np.zeros((3, 3)), sigma_m=0.1, crs=CRS))


@pytest.mark.long
def test_the_comparison_is_written(tmp_path: Path) -> None:
    study("carving-algorithm1")(tmp_path, quick=True, progress=lambda *_: None)
    rows = list(csv.DictReader((tmp_path / "comparison.csv").read_text().splitlines()))
    assert len(rows) == 5 * 2 * 3
    assert (tmp_path / "comparison.png").stat().st_size > 0
