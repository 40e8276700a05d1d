"""The glacier paper's Figs. 9 to 11: the table of fewest swaths, and the distributions that mislead."""

import csv

import pytest

from papers.glacier.monte_carlo import glacier_fig9, side_by_side


def test_the_fewest_swaths_of_both_patterns_stand_side_by_side():
    lengths = {("smooth", "lawnmower", 4): 2800.0, ("smooth", "piecewise-continuous", 2): 1400.0}
    rows = [
        {"terrain": terrain, "planner": planner, "swaths": swaths, "mean_length_m": length}
        for (terrain, planner, swaths), length in lengths.items()
    ]
    minimum = [
        {
            "terrain": terrain,
            "planner": planner,
            "limit_m": 0.4572,
            "fewest_by_mean": mean,
            "fewest_by_90_percent": share,
        }
        for terrain, planner, mean, share in (
            ("smooth", "lawnmower", 4, 5),
            ("smooth", "piecewise-continuous", 2, None),
            ("rough", "lawnmower", None, None),
            ("rough", "piecewise-continuous", None, None),
        )
    ]
    smooth, rough = side_by_side(minimum, rows)
    assert (smooth["lawnmower_by_mean"], smooth["piecewise_continuous_by_mean"]) == (4, 2)
    assert smooth["piecewise_continuous_by_90_percent"] is None
    assert smooth["distance_ratio"] == pytest.approx(0.5)
    assert rough["lawnmower_by_mean"] is None
    assert rough["distance_ratio"] is None


def test_alpha_and_beta_tell_what_the_share_of_visited_cells_does_not(tmp_path):
    glacier_fig9(tmp_path, quick=True, progress=lambda *_: None)
    with (tmp_path / "alpha_and_beta.csv").open() as file:
        found = {row["distribution"]: row for row in csv.DictReader(file)}
    even, corner, wander = found["lawnmower"], found["in one corner"], found["about its swaths"]
    # Nearly as many cells seen, from far other places.
    assert float(corner["scc"]) == pytest.approx(float(even["scc"]), abs=0.02)
    assert float(corner["alpha"]) > 0.4
    assert float(even["alpha"]) < 0.1
    assert float(wander["beta"]) > 1.0
    assert float(even["beta"]) == 0.0
    assert (tmp_path / "misleading_distributions.png").stat().st_size < 300_000
