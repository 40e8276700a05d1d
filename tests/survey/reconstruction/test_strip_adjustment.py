"""Strips of a cloud by their overlaps, on made ground with known errors of the strips."""

from dataclasses import replace

import numpy as np
import pytest

from survey import Grid, SurfacePoints
from survey.core.errors import InputError
from survey.reconstruction.mapping import reconstruct
from survey.reconstruction.strip_adjustment import compare_strips

HEIGHT_M = np.array([0.10, -0.06, 0.02])
MEAN_M = float(HEIGHT_M.mean())


def ground_m(x, y):
    return 300.0 + 0.3 * y + 2.0 * np.sin(x / 15.0)


def strip(rng, west, number, height_m=0.0, width=60.0, length=100.0, n=6000):
    """Return points (N, 3) of a strip with an offset [m], and their numbers."""
    x, y = west + rng.uniform(0.0, width, n), rng.uniform(0.0, length, n)
    z = ground_m(x, y) + height_m + rng.normal(0.0, 0.03, n)
    return np.column_stack([x, y, z]), np.full(n, float(number))


def cloud(*strips, names="strip"):
    xyz, numbers = (np.concatenate(parts) for parts in zip(*strips, strict=True))
    return SurfacePoints(xyz, sigma_m=0.03, values={names: numbers}, crs="EPSG:32608")


def three(seed=0, numbers=(7, 8, 9), **options):
    rng = np.random.default_rng(seed)
    return cloud(*(strip(rng, 40.0 * k, numbers[k], HEIGHT_M[k]) for k in range(3)), **options)


def test_heights_of_strips_are_found_within_their_errors() -> None:
    found = compare_strips(three())
    height_m, sigma_m = found.heights_m()
    off = np.abs(height_m - (HEIGHT_M - MEAN_M))
    assert off.max() < 0.006
    assert (off < 2.5 * sigma_m).all()
    assert sigma_m.max() < 0.02
    before_m, after_m = found.rms_m()
    assert before_m > 0.1
    assert after_m < 0.005


def test_adjusted_points_lie_on_one_surface_at_the_mean_of_the_strips() -> None:
    points = three()
    after = compare_strips(points).adjusted(points)
    rest = after.z - ground_m(*after.xy.T)
    means = [rest[points.values["strip"] == k].mean() for k in (7, 8, 9)]
    assert means == pytest.approx([MEAN_M] * 3, abs=0.012)
    assert compare_strips(after).rms_m()[0] < 0.008


@pytest.mark.parametrize("names", ["strip", "point_source_id"])
def test_a_strip_may_have_the_number_0(names: str) -> None:
    found = compare_strips(three(numbers=(0, 1, 2), names=names))
    facts = found.facts(is_adjusted=False)
    assert list(facts["strips"]) == ["0", "1", "2"]
    assert facts["overlaps"][0]["strips"] == ["0", "1"]
    assert facts["overlaps"][0]["height_m"] == pytest.approx(0.16, abs=0.006)


def test_heights_do_not_depend_on_the_place() -> None:
    points = three()
    moved = replace(points, xyz=points.xyz + [512.0, 1024.0, 64.0])
    one, other = (compare_strips(each).heights_m()[0] for each in (points, moved))
    assert one == pytest.approx(other, abs=6e-3)


def test_strips_without_overlap_are_named_and_stay() -> None:
    rng = np.random.default_rng(1)
    points = cloud(strip(rng, 0.0, 1, 0.1), strip(rng, 40.0, 2), strip(rng, 500.0, 3, 0.7))
    found = compare_strips(points)
    assert found.alone == (3,)
    assert "left as they are, without overlap: 3" in found.sentence(is_adjusted=True)
    after, far = found.adjusted(points), points.values["strip"] == 3
    assert (after.xyz[far] == points.xyz[far]).all()
    assert (after.xyz[~far] != points.xyz[~far]).any()


def test_groups_of_strips_count_from_their_own_means() -> None:
    rng = np.random.default_rng(2)
    heights = (0.10, 0.0, 1.0, 1.3)
    places = (0.0, 40.0, 500.0, 540.0)
    points = cloud(*(strip(rng, places[k], k + 1, heights[k]) for k in range(4)))
    found = compare_strips(points)
    assert found.n_groups == 2
    assert found.heights_m()[0] == pytest.approx([0.05, -0.05, -0.15, 0.15], abs=0.006)
    assert "in each of 2 groups" in found.sentence(is_adjusted=True)


def test_plants_that_one_strip_has_seen_are_left_out() -> None:
    rng = np.random.default_rng(5)
    points = cloud(
        strip(rng, 0.0, 1, 0.1, length=400.0, n=24_000), strip(rng, 40.0, 2, length=400.0, n=24_000)
    )
    planted = (points.values["strip"] == 2) & (points.xy[:, 1] < 60.0)
    found = compare_strips(replace(points, xyz=points.xyz + np.outer(planted, [0.0, 0.0, 0.3])))
    assert found.n_outliers > 0
    assert found.heights_m()[0] == pytest.approx([0.05, -0.05], abs=0.01)


def test_a_horizontal_shift_on_a_slope_counts_as_the_height_that_it_makes() -> None:
    points = three()
    shifted = replace(points, xyz=points.xyz + np.outer(points.values["strip"] == 8, [0.0, 0.2, 0.0]))
    expected = HEIGHT_M - [0.0, 0.3 * 0.2, 0.0]
    assert compare_strips(shifted).heights_m()[0] == pytest.approx(expected - expected.mean(), abs=0.01)


@pytest.mark.parametrize(
    "numbers", [(7, 7, 7), (0.5, 1.5, 2.5), (-1, 1, 2)], ids=["one strip", "fractions", "below 0"]
)
def test_points_that_do_not_name_several_strips_are_not_compared(numbers) -> None:
    assert compare_strips(three(numbers=numbers)) is None


def test_without_overlap_nothing_is_compared_and_an_adjustment_is_refused() -> None:
    rng = np.random.default_rng(3)
    points = cloud(strip(rng, 0.0, 1), strip(rng, 500.0, 2))
    found = compare_strips(points)
    assert "none overlaps another one" in found.sentence(is_adjusted=False)
    assert "strips" not in found.facts(is_adjusted=False)
    with pytest.raises(InputError, match="no strip overlaps another one"):
        found.adjusted(points)


def test_a_difference_is_named_only_where_it_is_larger_than_its_error() -> None:
    rng = np.random.default_rng(4)
    level = cloud(strip(rng, 0.0, 1), strip(rng, 40.0, 2))
    assert "--adjust-strips" not in compare_strips(level).sentence(is_adjusted=False)
    said = compare_strips(three()).sentence(is_adjusted=False)
    assert "7 lies 0.15" in said
    assert "m above 8" in said
    assert "--adjust-strips removes it" in said


def test_the_map_of_adjusted_points_holds_the_errors_of_the_adjustment() -> None:
    points = three()
    found = compare_strips(points)
    after = found.adjusted(points)
    plain = reconstruct(after, Grid((5.0, 5.0, 135.0, 95.0), 5.0, "EPSG:32608"), method="tin")
    held = found.recorded(plain, after, is_adjusted=True)
    added_m = np.sqrt(held.std.elevation**2 - plain.std.elevation**2)
    assert 0.005 < np.nanmin(added_m) <= np.nanmax(added_m) < 0.1
    assert (found.recorded(plain, points, is_adjusted=False).std.elevation == plain.std.elevation).all()
    assert held.diagnostics["strip_adjustment"]["is_adjusted"]


def test_the_result_is_the_same_every_time() -> None:
    one, other = (compare_strips(three()).adjusted(three()).xyz.tobytes() for _ in range(2))
    assert one == other
