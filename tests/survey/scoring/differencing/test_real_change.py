"""Change along the flow of real ground: the glacier in the crater of Mount St. Helens, and gullies that rest."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely

from survey import Dem
from survey.scoring import change
from survey.scoring.differencing.displacements import TrackedField
from survey.scoring.differencing.tracking import track

WINDOW = (562400.0, 5115500.0, 563500.0, 5117000.0)
DATES = ("20041004", "20050201", "20050714", "20060209", "20070705")
# Growing dome and the arm of the glacier that it pushes aside, and that arm alone.
MOVED = shapely.box(562450.0, 5115700.0, 563150.0, 5116700.0)
ARM = shapely.box(562850.0, 5116200.0, 563000.0, 5116600.0)


@pytest.fixture(scope="module")
def crater(real_data: Path) -> dict[str, Dem]:
    folder = real_data / "dem_volcano_msh_crater_series"
    if not folder.exists():
        pytest.skip(f"the crater {folder} is not here; set FIRNLINE_DATA")
    return {date: Dem.read(folder / f"merged10m_{date}.tif", bounds=WINDOW) for date in DATES}


def test_the_arm_of_the_crater_glacier_moves_by_a_tenth_of_a_metre_a_day(crater: dict[str, Dem]) -> None:
    early, late = crater["20050714"], crater["20060209"]
    found = track(early, late, window_px=21, step_px=10, search_px=8)
    field = TrackedField.of(found)
    middle = np.array([[562920.0, 5116400.0]])
    east, north = field.shift(middle)[0] / 210.0
    sigma = np.sqrt(field.covariance(middle)[0, 0, 0]) / 210.0
    assert -0.13 < east < -0.06
    assert abs(north) < 0.08
    assert sigma < 0.03


def test_fixed_places_and_moving_ice_change_differently(crater: dict[str, Dem]) -> None:
    early, late = crater["20050714"], crater["20060209"]
    field = TrackedField.of(track(early, late, window_px=21, step_px=10, search_px=8))
    found = change(late, early, {"moved": MOVED, "arm": ARM}, level=False, flow=field)
    assert found.along_flow is not None
    for volume, balance in zip(found.volumes, found.along_flow.balances, strict=True):
        assert np.isfinite(list(balance)[1:]).all()
        # The surface of the arm slopes: what moves along it does not change as a fixed place does.
        assert balance.along_std_m > volume.std_m3 / volume.area_m2
    assert abs(found.along_flow.balances[1].along_mean_m - found.volumes[1].mean_m) > 0.5


def test_the_crater_rises_between_all_dates_of_the_growth_of_its_dome(crater: dict[str, Dem]) -> None:
    gained = [
        np.nansum(crater[later].elevation - crater[earlier].elevation)
        for earlier, later in pairwise(DATES[:-1])
    ]
    assert min(gained) > 0.0


def test_gullies_between_three_lidar_surveys_rest_but_for_a_shift_of_decimetres(real_data: Path) -> None:
    folder = real_data / "dem_gully_fortbragg_3epochs"
    if not folder.exists():
        pytest.skip(f"the gullies {folder} are not here; set FIRNLINE_DATA")
    bounds = (597295.0, 150680.0, 597455.0, 150840.0)
    surveys = {
        year: Dem.read(folder / f"elevation_{year}_1m.tif", bounds=bounds) for year in (2004, 2012, 2016)
    }
    found = track(surveys[2012], surveys[2016], window_px=33, step_px=16, search_px=4)
    assert found.is_outlier.mean() < 0.05
    common = np.median(found.shift_m, axis=0)
    assert np.abs(common).max() < 0.4
    assert np.mean(np.abs(found.shift_m - common) < 1.96 * found.sigma_m) > 0.6
    # The first survey is smoother: most of its windows are flagged.
    assert track(surveys[2004], surveys[2012], window_px=33, step_px=16, search_px=4).is_outlier.mean() > 0.5
