"""Sizes are refused before work starts, with the largest that passes."""

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from affine import Affine

from planners import (
    Fleet,
    LawnmowerConfig,
    RandomWanderConfig,
    WavyConfig,
    plan,
    predict_error,
    terrain_kernel,
)
from planners.capacity import MOST_LINES
from planners.guarantee.guarantee import guarantee
from planners.guarantee.requirement import MapRequirement
from planners.registry import steering_of
from planners.steered_paths import rollout
from survey import CapacityError, Dem, SurveyArea
from survey.reconstruction.gp.kernels import SquaredExponential

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)
SIDE = 4100


@dataclass
class PeakMemory:
    """The most memory that Python held at once, in bytes."""

    bytes: int = 0


@contextmanager
def peak_memory() -> Iterator[PeakMemory]:
    """Measure the most memory that a block holds at once."""
    peak = PeakMemory()
    tracemalloc.start()
    try:
        yield peak
    finally:
        peak.bytes = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (LawnmowerConfig(swaths=1_000_000), "1000000 swaths .* at most 8000 can be planned, 0.075 m apart"),
        (LawnmowerConfig(spacing_m=1e-3), "600000 swaths .* at most 8000"),
        (LawnmowerConfig(spacing_m=1e-300), "at most 8000"),
        (LawnmowerConfig(swaths=4, tie_lines=10**9), "1000000000 swaths"),
        (LawnmowerConfig(spacing_m=1e-3, heading_rule="fewest-swaths"), "at most 8000"),
        (
            WavyConfig(swaths=4, wavelength_m=1e-6),
            "the wavelength = 1e-06 m gives .* waypoints; at most 2000000",
        ),
    ],
    ids=["swaths", "spacing", "tiny spacing", "tie lines", "fewest swaths", "waves"],
)
def test_patterns_of_too_many_pieces_are_refused_before_they_are_built(config, words):
    with peak_memory() as peak, pytest.raises(CapacityError, match=words):
        plan(SITE, None, config)
    assert peak.bytes < 8_000_000


def test_the_spacing_that_is_named_passes_the_check():
    with pytest.raises(CapacityError) as refusal:
        plan(SITE, None, LawnmowerConfig(swaths=10**6))
    named_m = float(str(refusal.value).split("planned, ")[1].split(" m apart")[0])
    assert 600.0 / named_m <= MOST_LINES


def test_steps_of_a_micrometre_are_refused_before_the_drive():
    config = RandomWanderConfig(swaths=2, step_m=1e-6)
    route = plan(SITE, None, config)
    with pytest.raises(CapacityError, match="the step = 1e-06 m"):
        rollout(SITE, route, steering_of(config), lambda *_: None, [np.random.default_rng(1)])


def test_a_million_rovers_are_refused():
    area = SurveyArea(SITE.polygon, CRS, starts=[[1.0, 1.0]])
    with pytest.raises(CapacityError, match=r"1000000 rovers .* at most 100"):
        plan(area, None, LawnmowerConfig(swaths=4), fleet=Fleet(rovers=10**6))


def test_a_separation_of_a_micrometre_per_second_is_refused():
    area = SurveyArea(SITE.polygon, CRS, starts=[[1.0, 1.0]])
    from planners import Rover

    slow = Rover(speed_m_s=1e-9)
    with pytest.raises(CapacityError, match="the separation"):
        plan(area, None, LawnmowerConfig(swaths=4), rover=slow, fleet=Fleet(rovers=2, separation_m=1e-9))


def test_predicted_maps_of_millimetre_cells_are_refused():
    route = plan(SITE, None, LawnmowerConfig(swaths=3))
    with pytest.raises(CapacityError, match="at most 40000 can be computed: take cells of at least"):
        predict_error(route, SITE, SquaredExponential(9.0, 100.0), noise_m=0.1, cell_m=1e-3)


def wide_prior() -> Dem:
    """Make a raster of 17 million cells of one elevation, just more than can be used."""
    return Dem(np.broadcast_to(5.0, (SIDE, SIDE)), Affine(1, 0, 0, 0, -1, SIDE), CRS)


def test_a_small_area_on_a_large_raster_uses_its_window_only():
    small = SurveyArea.rectangle((2000.0, 2000.0, 2030.0, 2030.0), CRS)
    prior = wide_prior()
    with peak_memory() as peak:
        terrain_kernel(prior, small)
    assert peak.bytes < 2 * SIDE**2  # two bytes a cell; its heights take eight


def test_more_cells_than_can_be_used_are_refused():
    with pytest.raises(CapacityError, match="cells over the area; at most 16000000"):
        terrain_kernel(wide_prior(), SurveyArea.rectangle((0.0, 0.0, SIDE, SIDE), CRS))


def test_samples_of_a_guarantee_are_counted_before_they_are_drawn():
    rng = np.random.default_rng(2)
    cells = Dem(rng.standard_normal((12, 12)), Affine(50, 0, 0, 0, -50, 600), CRS)
    with pytest.raises(CapacityError, match="take a sample spacing of at least"):
        guarantee(SITE, cells, MapRequirement(0.5, sample_step_m=1e-9, n_simulations=10))


@pytest.mark.long
def test_a_hundred_kilometres_are_too_large_to_simulate():
    rng = np.random.default_rng(2)
    cells = Dem(rng.standard_normal((12, 12)), Affine(1e4, 0, 0, 0, -1e4, 1.2e5), CRS)
    area = SurveyArea(shapely.box(0.0, 0.0, 1.2e5, 1.2e5), CRS)
    with pytest.raises(CapacityError, match="at most 5000000 can be used: take a sample spacing"):
        guarantee(area, cells, MapRequirement(0.5, n_simulations=10, max_swaths=1000))
