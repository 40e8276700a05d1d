"""Intensity of counts: its interval holds the truth, wrong counts are refused, files come back."""

from pathlib import Path

import numpy as np
import pytest

from sim.instruments.counter import RadiationWorld, UnevenWorld
from survey.core import FloatArray, InputError
from survey.core.streams import stream
from survey.reconstruction.counts.counts import Counts
from survey.reconstruction.counts.intensity import (
    CountHyperparameters,
    IntensityField,
    LogIntensity,
)

SIDE_M = 160.0


def lines() -> FloatArray:
    east, north = np.meshgrid(np.arange(5.0, SIDE_M, 10.0), np.arange(10.0, SIDE_M, 20.0))
    return np.column_stack([east.ravel(), north.ravel()])


def nodes() -> FloatArray:
    return np.stack(np.meshgrid(*2 * [np.arange(6.0, SIDE_M, 8.0)]), axis=-1).reshape(-1, 2)


def test_the_interval_holds_the_true_intensity() -> None:
    within = []
    for seed in range(2):
        world = UnevenWorld(8.0, 0.8, 40.0, stream(seed, "test of counts"))
        counts = world.count(lines(), np.full(len(lines()), 10.0))
        found, truth = IntensityField.fit(counts).at(nodes()), world.rate(nodes())
        within.append(np.mean((truth >= found.quantile(0.025)) & (truth <= found.quantile(0.975))))
    assert 0.88 <= np.mean(within) <= 0.995


def test_counts_of_one_intensity_give_it_with_the_error_of_their_sum() -> None:
    rng = stream(1, "even")
    counts = Counts(lines(), rng.poisson(50.0, len(lines())).astype(float), np.full(len(lines()), 10.0))
    found = IntensityField.fit(counts).at(nodes())
    np.testing.assert_allclose(found.quantile(0.5), 5.0, rtol=0.1)
    assert np.all(found.quantile(0.975) / found.quantile(0.025) < 1.4)
    assert np.all(found.below(6.5) > 0.95)
    assert np.all(found.below(4.0) < 0.05)


def test_dispersed_counts_are_known_worse_than_poisson_counts() -> None:
    rng, exposure_s = stream(2, "gusts"), np.full(len(lines()), 10.0)
    gusty = rng.poisson(50.0 * rng.gamma(2.0, 0.5, len(lines()))).astype(float)
    steady = rng.poisson(50.0, len(lines())).astype(float)
    factors = []
    for n in (gusty, steady):
        found = IntensityField.fit(Counts(lines(), n, exposure_s)).at(nodes())
        factors.append(np.median(found.quantile(0.975) / found.quantile(0.025)))
    assert factors[0] > 1.5 * factors[1]


def test_far_from_counts_the_interval_is_as_wide_as_the_field_varies() -> None:
    world = RadiationWorld(np.array([80.0, 80.0]), 5e3, 5.0, stream(3, "far"))
    counts = world.count(lines(), np.full(len(lines()), 10.0))
    field = IntensityField(counts, [(1.0, CountHyperparameters("matern-3/2", 0.7, 30.0, 0.01))])
    far, near = field.at(np.array([[1000.0, 80.0], [80.0, 80.0]])).sd[0]
    assert far == pytest.approx(0.7, rel=0.1)
    assert near < 0.3


def test_a_quantile_of_a_mixture_has_its_probability() -> None:
    mixture = LogIntensity(
        np.array([0.3, 0.7]), np.array([[0.0, 2.0], [1.0, -1.0]]), np.array([[0.5, 0.1], [1.0, 0.4]])
    )
    for share in (0.025, 0.5, 0.975):
        for place in range(2):
            rate = mixture.quantile(share)[place]
            assert mixture.below(rate)[place] == pytest.approx(share, abs=1e-6)


def test_sums_over_blocks_keep_counts_and_do_not_reach_over_gaps() -> None:
    xy = np.column_stack([np.r_[np.arange(10.0), 1000.0 + np.arange(10.0)], np.zeros(20)])
    blocks = Counts(xy, np.arange(20.0), np.ones(20)).in_blocks(5)
    assert blocks.n.sum() == 190.0
    assert blocks.exposure_s.sum() == 20.0
    assert not np.any((blocks.xy[:, 0] > 20.0) & (blocks.xy[:, 0] < 990.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"n": -1.0}, "whole numbers of 0 or more"),
        ({"n": 1.5}, "not a rate"),
        ({"exposure_s": 0.0}, "longer than 0 s"),
    ],
)
def test_wrong_counts_are_refused_with_their_row(change: dict[str, float], words: str) -> None:
    columns = {"xy": np.zeros((12, 2)), "n": np.ones(12), "exposure_s": np.ones(12)}
    for name, value in change.items():
        columns[name][4] = value
    with pytest.raises(InputError, match=words) as refusal:
        Counts(**columns)
    assert "5 of 12" in str(refusal.value)


@pytest.mark.parametrize(
    ("n", "xy", "words"),
    [
        (np.zeros(160), lines()[:160], "nothing was counted"),
        (np.ones(160), np.zeros((160, 2)), "lie within 0 m"),
        (np.ones(5), lines()[:5], "at least 10"),
    ],
)
def test_what_gives_no_map_is_refused(n: FloatArray, xy: FloatArray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        IntensityField.fit(Counts(xy[: len(n)], n[: len(xy)], np.ones(min(len(n), len(xy)))))


def test_counts_come_back_from_their_file(tmp_path: Path) -> None:
    wind = np.column_stack([np.full(12, 2.0), np.linspace(-1.0, 1.0, 12)])
    counts = Counts(np.arange(24.0).reshape(12, 2), np.arange(12.0), np.full(12, 5.0), wind)
    counts.write(tmp_path / "counts.csv")
    again = Counts.read(tmp_path / "counts.csv")
    for name in ("xy", "n", "exposure_s", "wind_m_s"):
        np.testing.assert_allclose(getattr(again, name), getattr(counts, name))


def test_half_of_a_wind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "half.csv").write_text("easting_m,northing_m,counts,exposure_s,wind_east_m_s\n0,0,1,1,2\n")
    with pytest.raises(InputError, match="needs both"):
        Counts.read(tmp_path / "half.csv")
