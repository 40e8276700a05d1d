"""Gross blunders among points are named and left out, or refused; ground that is only rough is not."""

from collections.abc import Callable

import numpy as np
import pytest

from survey import InputError, SurfacePoints
from survey.core.arrays import FloatArray
from survey.reconstruction.observations import (
    Blunders,
    refuse_far_places,
    refuse_feet_among_metres,
    without_blunders,
)


def xyz(n: int = 400, seed: int = 0) -> FloatArray:
    """Return places and heights of hills of 36 m."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 300.0, (n, 2))
    z = 800.0 + 10.0 * np.sin(xy[:, 0] / 60.0) + 8.0 * np.cos(xy[:, 1] / 45.0) + 0.05 * rng.standard_normal(n)
    return np.column_stack([xy + [500_000.0, 6_700_000.0], z])


def points(array: FloatArray) -> SurfacePoints:
    return SurfacePoints(array, sigma_m=0.05, crs="EPSG:32608")


def cliff(array: FloatArray) -> FloatArray:
    """Return a step of 80 m along a line through all of the site."""
    array[:, 2] += np.where(array[:, 0] > 500_120.0, 80.0, 0.0)
    return array


def tower(array: FloatArray) -> FloatArray:
    """Return a rock of 60 m that seven points stand on."""
    on_it = np.argsort(np.hypot(array[:, 0] - 500_150.0, array[:, 1] - 6_700_150.0))[:7]
    array[on_it, 2] += 60.0
    return array


def boulders(array: FloatArray) -> FloatArray:
    """Return points on boulders of up to 9 m, far below the relief."""
    array[::40, 2] += np.linspace(3.0, 9.0, len(array[::40]))
    return array


@pytest.mark.parametrize("relief", [lambda array: array, cliff, tower, boulders])
@pytest.mark.parametrize("seed", range(8))
def test_ground_that_is_rough_holds_no_blunder(relief: Callable[[FloatArray], FloatArray], seed: int) -> None:
    given = points(relief(xyz(seed=seed)))
    kept, found = without_blunders(given)
    assert kept is given
    assert len(found.rows) == 0
    refuse_feet_among_metres(given)
    refuse_far_places(given)


def test_blunders_are_found_with_their_rows_places_and_sizes() -> None:
    array = xyz()
    array[[10, 200, 399], 2] += [100.0, -130.0, 100.0]
    kept, found = without_blunders(points(array))
    assert found.rows.tolist()[0] == 200
    assert sorted(found.rows) == [10, 200, 399]
    assert found.above_m[0] == pytest.approx(-130.0, abs=8.0)
    np.testing.assert_array_equal(found.xy, array[found.rows, :2])
    np.testing.assert_array_equal(kept.xyz, np.delete(array, [10, 200, 399], axis=0))
    assert found.facts()["n"] == 3
    place = f"{array[200, 0]:.2f}, {array[200, 1]:.2f}"
    assert found.sentence().startswith(
        f"3 points stand alone in height and count as blunders: the largest is point 201, at {place}, 1"
    )
    assert "below its neighbours" in found.sentence()


def test_a_single_blunder_among_few_points_is_found() -> None:
    array = xyz(40)
    array[7, 2] += 200.0
    found = Blunders.among(array, 0.05)
    assert found.rows.tolist() == [7]
    assert found.sentence().startswith(
        "1 point stands alone in height and counts as a blunder: it is point 8"
    )


def test_too_few_points_show_nothing() -> None:
    array = xyz(20)
    array[7, 2] += 500.0
    given = points(array)
    assert without_blunders(given)[0] is given
    refuse_far_places(points(np.vstack([array, [0.0, 0.0, 800.0]])))


@pytest.mark.parametrize("rows", [[3], [3, 4, 5, 6], list(range(0, 400, 2))])
def test_feet_among_metres_are_refused(rows: list[int]) -> None:
    array = xyz()
    array[rows, 2] /= 0.3048
    words = rf"^{len(rows)} of 400 heights lie between .* those are in feet, the first at point {rows[0] + 1}; convert"
    with pytest.raises(InputError, match=words):
        refuse_feet_among_metres(points(array))


def test_two_sites_at_other_heights_are_no_feet() -> None:
    array = xyz()
    array[:100, 2] += 900.0
    array[:100, 0] += 5_000.0
    refuse_feet_among_metres(points(array))


@pytest.mark.parametrize("place", [[6_700_144.0, 500_163.0], [0.0, 6_700_010.0], [0.0, 0.0]])
def test_a_place_far_from_all_others_is_refused(place: list[float]) -> None:
    array = xyz()
    array[41, :2] = place
    with pytest.raises(
        InputError, match=rf"^1 of 400 points lies far from all others: point 42 at {place[0]:.2f}"
    ):
        refuse_far_places(points(array))


def test_a_base_station_some_kilometres_away_is_none_of_them() -> None:
    array = xyz()
    array[0, 0] += 5_000.0
    refuse_far_places(points(array))
