"""Change along the flow of the ice, and the divergence of its flux."""

import numpy as np
import pytest
import shapely

from survey import Dem, Grid, InputError
from survey.data.ice_motion import IceMotion
from survey.reconstruction.motion.priors import uniform_motion
from survey.scoring import change
from survey.scoring.differencing.along_flow import Thickness
from survey.scoring.differencing.displacements import SteadyField, TrackedField
from survey.scoring.differencing.tracking import track

GRID = Grid((0.0, 0.0, 600.0, 600.0), 6.0, "EPSG:32608")
ICE = shapely.box(100.0, 100.0, 400.0, 500.0)
DAYS, MELT_M = 10.0, 0.8


def bumps(xy: np.ndarray) -> np.ndarray:
    x, y = xy.T
    return 0.05 * x + 3.0 * np.sin(x / 25.0) * np.cos(y / 30.0)


def surveys(
    shift: tuple[float, float] = (6.0, -3.0), noise_m: float = 0.02, seed: int = 1
) -> tuple[Dem, Dem]:
    """Return a surface before and after its ice moved and melted; the ground about it rests."""
    rng, xy = np.random.default_rng(seed), GRID.xy
    moved = np.where(shapely.contains_xy(ICE, *xy.T)[:, None], shift, 0.0)
    after = bumps(xy - moved) - np.where(moved.any(axis=1), MELT_M, 0.0)
    heights = (one + noise_m * rng.standard_normal(len(xy)) for one in (bumps(xy), after))
    early, late = (Dem.on(GRID, one.reshape(GRID.shape)) for one in heights)
    return late, early


def uniform(sigma: float) -> SteadyField:
    motion = uniform_motion((0.6, -0.3), 0.0, velocity_sigma=sigma, lowering_sigma=0.0, epoch_s=0.0)
    return SteadyField(motion, DAYS)


def test_the_change_along_the_flow_is_the_melt_where_that_at_fixed_places_is_not():
    found = change(*surveys(), {"ice": ICE}, flow=uniform(0.001))
    along = found.along_flow
    assert along is not None
    inside = shapely.contains_xy(ICE.buffer(-30.0), *GRID.xy.T).reshape(GRID.shape)
    np.testing.assert_allclose(along.difference.elevation[inside], -MELT_M, atol=0.15)
    assert np.std(found.difference.elevation[inside]) > 0.3
    assert abs(along.balances[0].along_mean_m + MELT_M) < 3.0 * along.balances[0].along_std_m + 0.1


def test_an_uncertain_flow_widens_the_change_along_it_where_the_surface_slopes():
    sure, vague = (change(*surveys(), {"ice": ICE}, flow=uniform(sigma)).along_flow for sigma in (0.0, 0.2))
    assert sure is not None
    assert vague is not None
    slope = np.hypot(*Dem.on(GRID, bumps(GRID.xy).reshape(GRID.shape)).gradient())
    wider = vague.std_m - sure.std_m
    assert np.nanmean(wider[slope > 0.1]) > 5.0 * np.nanmean(wider[slope < 0.03])
    # The mean slope of the outline is some 0.05, and the displacement errs by 2 m all over it.
    assert 0.03 < vague.balances[0].along_std_m < 0.3


def test_a_stretching_flow_thins_the_ice_by_its_divergence():
    stretching = IceMotion(
        np.array([[0.6, 2.0, 0.0], [-0.3, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        0.0,
        np.array([250.0, 300.0]),
        np.zeros((9, 0)),
    )
    flow = SteadyField(stretching, DAYS)
    balance = change(
        *surveys(), {"ice": ICE}, flow=flow, thickness=Thickness(100.0, 0.1)
    ).along_flow.balances[0]
    # 2 m a day over a kilometre for 10 days: 0.02, times nine tenths of 100 m.
    assert balance.flux_divergence_m == pytest.approx(0.02 * 0.9 * 100.0, rel=0.02)
    assert balance.flux_divergence_std_m == pytest.approx(1.8 * np.hypot(0.1, 0.058 / 0.9), rel=0.05)
    mean = change(*surveys(), {"ice": ICE}).volumes[0].mean_m
    assert balance.balance_m == pytest.approx(mean + balance.flux_divergence_m)


def test_a_flow_of_one_velocity_has_no_divergence_and_its_error_is_that_of_no_plane():
    balance = change(*surveys(), {"ice": ICE}, flow=uniform(0.2)).along_flow.balances[0]
    assert abs(balance.flux_divergence_m) < 1e-9
    assert balance.flux_divergence_std_m < 1e-6
    assert balance.thickness_m > 50.0


def test_intervals_of_the_change_along_a_tracked_flow_hold_the_melt():
    scores = []
    for seed in range(2):
        late, early = surveys(noise_m=0.05, seed=seed)
        field = TrackedField.of(track(early, late, window_px=15, step_px=12, search_px=3))
        inner = {"ice": ICE.buffer(-60.0)}
        along = change(
            late, early, inner, stable=shapely.box(430.0, 0.0, 600.0, 600.0), flow=field
        ).along_flow
        scores.append((along.balances[0].along_mean_m + MELT_M) / along.balances[0].along_std_m)
    assert np.abs(scores).max() < 3.0


def test_a_tracked_field_of_too_few_windows_is_refused():
    late, early = surveys()
    found = track(early, late, window_px=15, step_px=40, search_px=4)
    with pytest.raises(InputError, match="no outliers"):
        TrackedField.of(found)
