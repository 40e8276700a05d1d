"""Surveys, other gridders and scores of the benchmark of maps of real ground, on surfaces that are known."""

import json
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from pyproj import CRS

from benchmarks.gridders_on_real_ground import scores
from benchmarks.gridders_on_real_ground.__main__ import over_best_peer, prior_over_without
from benchmarks.gridders_on_real_ground.figure import ratio_figure
from benchmarks.gridders_on_real_ground.gridders import OURS, PEERS, Gridder, Surface, quietly
from benchmarks.gridders_on_real_ground.scores import Case, Judged, Score, judged, score_of
from benchmarks.gridders_on_real_ground.surveys import LINES, N_LANDMARKS, Survey, block_means, samples_of
from survey import Dem, Grid
from survey.core.streams import stream

SQUARE = (500_000.0, 6_000_000.0, 500_240.0, 6_000_240.0)
UTM = CRS("EPSG:32608")


def plane(xy: np.ndarray) -> np.ndarray:
    """Heights of a slope to the north-east, 1 m over 10 m to the east and half of it to the north."""
    return 100.0 + 0.1 * (xy[:, 0] - SQUARE[0]) + 0.05 * (xy[:, 1] - SQUARE[1])


@pytest.fixture
def on_a_plane() -> Survey:
    grid = Grid(SQUARE, 12.0, UTM)
    xy = Grid(SQUARE, 30.0, UTM).xy + 0.01 * stream(1, "places").standard_normal((81, 2))
    prior = Dem(np.zeros((8, 8)), Affine(30.0, 0.0, SQUARE[0], 0.0, -30.0, SQUARE[3]), UTM)
    return Survey(xy, plane(xy), np.full(len(xy), 0.01), grid, plane(grid.xy), prior)


@pytest.mark.parametrize("along_y", [False, True])
@pytest.mark.parametrize("kind", LINES)
def test_lines_begin_half_a_spacing_from_the_fence(kind: str, along_y: bool) -> None:
    samples = samples_of(kind, SQUARE, stream(1), along_y=along_y)
    along, across = (samples.xy - SQUARE[:2]).T[:: -1 if along_y else 1]
    spacing_m = 240.0 / LINES[kind]
    assert np.unique(across) == pytest.approx(spacing_m * (np.arange(LINES[kind]) + 0.5))
    assert np.unique(along) == pytest.approx(np.linspace(0.0, 240.0, 41))
    assert len(samples.xy) == len(samples.sigma_m) == 41 * LINES[kind]


def test_landmarks_lie_about_lines_and_are_less_precise_farther_off() -> None:
    samples = samples_of("landmarks", SQUARE, stream(1), along_y=False)
    across = samples.xy[:, 1] - SQUARE[1]
    off_m = np.abs(across[:, None] - 60.0 * (np.arange(4) + 0.5)).min(axis=1)
    assert len(across) == N_LANDMARKS
    assert np.mean(off_m < 15.0) > 0.7
    # The range is at least the distance to the nearest line.
    assert (samples.sigma_m >= np.minimum(0.05 + 0.01 * off_m, 0.5) - 1e-9).all()


def test_a_prior_is_block_means_with_white_and_common_errors() -> None:
    bounds = (0.0, 0.0, 300.0, 300.0)
    terrain = Dem.on(Grid((0.5, 0.5, 299.5, 299.5), 1.0, UTM), np.tile(0.5 * np.arange(300), (300, 1)))
    priors = [block_means(terrain, bounds, stream(seed)) for seed in range(40)]
    errors = np.array([prior.elevation - terrain.at(prior.xy).reshape(prior.shape) for prior in priors])
    assert errors.shape == (40, 10, 10)
    common = errors.mean(axis=(1, 2))
    assert np.std(errors - common[:, None, None]) == pytest.approx(1.0, abs=0.05)
    assert np.std(common) == pytest.approx(0.5, abs=0.15)


def test_cells_are_smaller_on_small_windows() -> None:
    terrain = Dem.on(Grid((0.5, 0.5, 149.5, 149.5), 1.0, UTM), np.zeros((150, 150)))
    assert block_means(terrain, (0.0, 0.0, 150.0, 150.0), stream(1)).step_m == 15.0


@pytest.mark.parametrize("gridder", [OURS[0], *PEERS], ids=lambda gridder: gridder.name)
def test_a_gridder_finds_a_plane(gridder: Gridder, on_a_plane: Survey) -> None:
    if not gridder.is_installed:
        pytest.skip(f"{gridder.needs} is not installed")
    surface = quietly(gridder, on_a_plane)
    # Inverse distances of all samples draw every height to the mean.
    share = 0.8 if gridder.name.endswith("invdist") else 0.1
    assert score_of(surface, on_a_plane.truth).rmse_m < share * on_a_plane.truth.std()
    assert surface.std is None or surface.std.shape == on_a_plane.truth.shape


def test_errors_as_large_as_stated_are_covered_as_often_as_stated() -> None:
    error = stream(1).standard_normal(200_000)
    found = score_of(Surface(5.0 + error, np.ones_like(error)), np.full_like(error, 5.0))
    assert found.rmse_m == pytest.approx(1.0, abs=0.01)
    assert found.coverage == pytest.approx(0.95, abs=0.002)
    assert found.crps_m == pytest.approx(1.0 / np.sqrt(np.pi), abs=0.005)


def test_the_crps_of_a_certain_height_is_its_error() -> None:
    assert scores.crps_m(np.array([0.5, -1.5]), np.full(2, 1e-6)) == pytest.approx(1.0)


def test_the_best_peer_is_the_one_with_the_least_error_of_those_that_found_a_surface() -> None:
    ours = {OURS[0].name: Score(0.3, 0.95, 0.1), OURS[1].name: Score(0.15, 0.95, 0.1)}
    one = Judged(
        Case("hills", 0, "side/4"), {**ours, PEERS[0].name: Score(0.6, 0.9, 0.2), PEERS[3].name: Score(0.4)}
    )
    assert over_best_peer(one) == pytest.approx(0.75)
    assert prior_over_without(one) == pytest.approx(0.5)
    assert one.best_crps_m == 0.2
    figure = ratio_figure([one], ("side/4", "landmarks"))
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()][:2] == [
        "firnline, prior",
        "firnline",
    ]


def test_a_gridder_that_is_not_installed_is_named() -> None:
    assert scores.missing([Gridder("absent", "no_such_module", lambda survey: Surface(survey.truth))]) == [
        "absent"
    ]


def test_scores_are_stored_and_a_gridder_that_fails_has_none(
    on_a_plane: Survey, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(survey: Survey) -> Surface:
        raise np.linalg.LinAlgError("singular matrix")

    exact = Gridder("exact", "scipy", lambda survey: Surface(survey.truth))
    monkeypatch.setattr(scores, "OURS", (exact,))
    monkeypatch.setattr(
        scores, "PEERS", (Gridder("failing", "scipy", fails), Gridder("absent", "no_such", fails))
    )
    monkeypatch.setattr(scores, "_survey", lambda _: on_a_plane)
    monkeypatch.setattr(scores, "_folder", lambda **_: tmp_path)
    assert list(judged(Case("hills", 0, "side/4")).scores) == ["exact"]
    assert json.loads((tmp_path / "hills-0-side_4-failing.json").read_text(encoding="utf-8")) == {}
