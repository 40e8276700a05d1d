"""Search for a source: it is found in worlds with a known place, and a place is stated only where it is known."""

import math

import numpy as np
import pytest

from planners.source_search import SourceSeeker
from sim.instruments.counter import PlumeWorld, RadiationWorld
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.reconstruction.counts.counts import Counts
from survey.reconstruction.counts.sources import (
    Belief,
    InverseSquare,
    SourcePrior,
    SourceSearch,
    SteadyPlume,
)

BOUNDS = (0.0, 0.0, 120.0, 120.0)
PRIOR = SourcePrior(BOUNDS, (1e2, 1e6), (0.5, 100.0))
SEEKER = SourceSeeker(SurveyArea.rectangle(BOUNDS, "EPSG:32608"))
EXPOSURES_S = np.array([10.0, 10.0, 10.0])


def test_a_search_ends_at_the_source() -> None:
    world = RadiationWorld(np.array([80.0, 70.0]), 8e3, 8.0, stream(1, "world"))
    search, at, found = (
        SourceSearch(InverseSquare(), PRIOR, stream(1, "particles")),
        np.array([5.0, 5.0]),
        None,
    )
    for _ in range(40):
        to = SEEKER.next_place(search, at)
        assert SEEKER.area.contains(to[None]).all()
        search.add(world.count(np.linspace(at, to, 4)[1:], EXPOSURES_S))
        at, found = to, SEEKER.found(search)
        if found is not None:
            break
    assert found is not None
    assert found.probability >= 0.9
    assert np.hypot(*(found.xy - world.source_xy)) <= 10.0


def test_nothing_is_stated_while_only_background_is_counted() -> None:
    search = SourceSearch(InverseSquare(), PRIOR, stream(2, "particles"))
    rng = stream(2, "background")
    places = rng.uniform(0.0, 40.0, (40, 2))
    search.add(Counts(places, rng.poisson(80.0, 40).astype(float), np.full(40, 10.0)))
    assert SEEKER.found(search) is None
    assert search.belief.within(10.0)[1] < 0.3


def test_a_plume_leads_up_the_wind() -> None:
    world = PlumeWorld(np.array([30.0, 60.0]), 5e4, 5.0, np.array([3.0, 0.0]), stream(3, "world"))
    places = np.stack(np.meshgrid(np.arange(5.0, 120.0, 20.0), np.arange(10.0, 120.0, 10.0)), axis=-1)
    counts = world.count(places.reshape(-1, 2), np.full(places.size // 2, 10.0))
    search = SourceSearch(SteadyPlume(height_m=1.0), PRIOR, stream(3, "particles"), counts)
    search.with_share(1.0)
    place, probability = search.belief.within(10.0)
    assert probability > 0.5
    assert np.hypot(*(place - world.source_xy)) <= 10.0


def test_counts_that_deviate_together_are_worth_fewer() -> None:
    rng = stream(4, "slow")
    slow = np.repeat(rng.gamma(4.0, 0.25, 8), 8)
    places = np.column_stack([np.linspace(0.0, 120.0, 64), np.full(64, 5.0)])
    shares = []
    for factor in (slow, np.ones(64)):
        counts = Counts(places, rng.poisson(100.0 * factor).astype(float), np.full(64, 10.0))
        search = SourceSearch(InverseSquare(), PRIOR, stream(4, "particles"), counts)
        search.with_share(1.0)
        shares.append(search.independent_share())
    assert shares[0] < 0.3
    assert shares[1] > 0.6


def test_the_likelihood_is_that_of_the_negative_binomial_distribution() -> None:
    from scipy.stats import nbinom

    rng = stream(5, "likelihood")
    places = rng.uniform(0.0, 120.0, (20, 2))
    counts = Counts(places, rng.poisson(60.0, 20).astype(float), np.full(20, 10.0))
    search = SourceSearch(InverseSquare(), PRIOR, stream(5, "particles"), counts)
    particle = np.array([[60.0, 60.0, math.log(2e3), math.log(5.0), math.log(0.1)]])
    unit = InverseSquare().of(counts, particle).unit[0]
    mu = counts.exposure_s * (5.0 + 2e3 * unit)
    wanted = nbinom.logpmf(counts.n, 10.0, 10.0 / (10.0 + mu)).sum() + np.sum(
        [math.lgamma(n + 1.0) for n in counts.n]
    )
    found = search._likelihood_of(particle, counts, np.ones(20))[0]
    assert found == pytest.approx(wanted, rel=1e-9)


def test_a_belief_names_the_place_with_the_most_weight() -> None:
    xy = np.array([[0.0, 0.0], [1.0, 0.0], [50.0, 50.0]])
    belief = Belief(xy, np.array([0.45, 0.45, 0.1]), 1.0)
    place, probability = belief.within(5.0)
    np.testing.assert_allclose(place, [0.5, 0.0])
    assert probability == pytest.approx(0.9)
