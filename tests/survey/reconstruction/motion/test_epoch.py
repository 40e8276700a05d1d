"""Maps of moving ice at another epoch."""

import numpy as np
import pytest

from survey import Dem, Grid, InputError, Reconstruction
from survey.data.ice_motion import DAY_S
from survey.reconstruction.motion.epoch import AGE, at_epoch, with_age
from survey.reconstruction.motion.priors import uniform_motion
from survey.reconstruction.terrain_map import MEASURED, UNSEEN

GRID = Grid((0.0, 0.0, 100.0, 60.0), 2.0, "EPSG:32608")


def heights(xy: np.ndarray) -> np.ndarray:
    return 0.1 * xy[:, 0] + 2.0 * np.sin(xy[:, 0] / 15.0) * np.cos(xy[:, 1] / 12.0)


def surveyed(**changes: object) -> Reconstruction:
    mean = Dem.on(GRID, heights(GRID.xy).reshape(GRID.shape))
    std = Dem.on(GRID, np.full(GRID.shape, 0.1))
    return Reconstruction(mean, std, np.full(GRID.shape, MEASURED), "joint", {}, **changes)


MOTION = uniform_motion((4.0, -2.0), 0.05, velocity_sigma=0.1, lowering_sigma=0.02, epoch_s=0.0)


def test_the_surface_is_carried_on_and_lowered():
    moved, later = at_epoch(surveyed(), MOTION, 2.0 * DAY_S)
    real = heights(GRID.xy - [8.0, -4.0]).reshape(GRID.shape) - 0.1
    known = np.isfinite(moved.mean.elevation)
    assert 0.75 < known.mean() < 0.9
    np.testing.assert_allclose(moved.mean.elevation[known], real[known], atol=0.02)
    assert (moved.support[~known] == UNSEEN).mean() > 0.9
    assert later.epoch_s == 2.0 * DAY_S


def test_its_standard_deviation_grows_by_that_of_the_motion():
    moved, _ = at_epoch(surveyed(), MOTION, 2.0 * DAY_S)
    slope = np.hypot(*moved.mean.gradient())
    known = np.isfinite(moved.std.elevation) & np.isfinite(slope)
    expected = np.sqrt(0.1**2 + 0.04**2 + (0.2 * slope) ** 2)
    np.testing.assert_allclose(moved.std.elevation[known], expected[known], rtol=0.03)


def test_its_own_epoch_gives_the_same_map():
    moved, _ = at_epoch(surveyed(), MOTION, 0.0)
    np.testing.assert_array_equal(moved.mean.elevation, surveyed().mean.elevation)
    inner = np.isfinite(moved.std.elevation)
    np.testing.assert_allclose(moved.std.elevation[inner], 0.1)


def test_a_map_with_its_age_states_velocity_and_lowering():
    facts = with_age(surveyed(), MOTION).diagnostics[AGE]
    assert facts["speed_m_per_day"] == pytest.approx(np.hypot(4.0, 2.0))
    assert facts["lowering_sigma_m_per_day"] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("changes", "epoch_s", "said"),
    [({"quantity": "ph"}, DAY_S, "map is one of ph"), ({}, 100.0 * DAY_S, "has left it")],
)
def test_other_quantities_and_epochs_too_far_are_refused(changes: dict, epoch_s: float, said: str):
    with pytest.raises(InputError, match=said):
        at_epoch(surveyed(**changes), MOTION, epoch_s)
