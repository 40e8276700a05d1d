"""The carving study's world: what its scanner sees is there, and seen over the ground between."""

import csv
from pathlib import Path

import numpy as np
import pytest

from papers.carving.figures import SENSOR_M, SLOPE_DEG, downhill_drive, seen_of_the_sine, sine
from papers.carving.world import NOISE_M, TERRAINS, ScanTrial
from papers.studies import study


def test_hits_lie_on_the_ground_and_lines_of_sight_above_it() -> None:
    trial = ScanTrial.new("piles", 7, n_train=500, n_test=200)
    assert (len(trial.train), len(trial.test), len(trial.reference)) == (500, 200, 3600)
    off = trial.train.z - trial.world.heights(trial.train.xy)
    # Most rays graze the ground, where an error of the range is a smaller one of the height.
    assert np.median(np.abs(off)) < NOISE_M
    for u in np.linspace(0.1, 1.0, 10):
        sight = trial.train.xyz + u * (trial.train.origins - trial.train.xyz)
        clearance = sight[:, 2] - trial.world.heights(sight[:, :2])
        # Five standard deviations of a range, on a heap's side.
        assert clearance.min() > -5.0 * NOISE_M * 1.2


def test_terrains_are_known_by_their_seed_and_get_flatter() -> None:
    relief = {}
    for name in TERRAINS:
        z = ScanTrial.new(name, 7, n_train=10, n_test=10).reference[:, 2]
        relief[name] = float(np.ptp(z))
    assert min(relief[name] for name in tuple(TERRAINS)[:3]) > relief["nearly flat"] > relief["flat"] > 0.0
    again = ScanTrial.new("flat", 7, n_train=10, n_test=10)
    np.testing.assert_array_equal(again.train.xyz, ScanTrial.new("flat", 7, n_train=10, n_test=10).train.xyz)


def test_clutter_scatters_hits_and_leaves_the_ground() -> None:
    trial = ScanTrial.new("flat", 7, n_train=2000, n_test=10, clutter_m=0.25)
    off = trial.train.z - trial.world.heights(trial.train.xy)
    assert np.std(off) == pytest.approx(0.25, rel=0.05)
    clear = ScanTrial.new("flat", 7, n_train=10, n_test=10)
    np.testing.assert_array_equal(trial.reference, clear.reference)


def test_the_lane_falls_by_five_degrees() -> None:
    x = np.linspace(0.0, 12.0, 200)
    z = downhill_drive().heights(np.column_stack([x, np.zeros_like(x)]))
    # Ripples of 3 cm on a fall of 1 m.
    assert abs(np.degrees(np.arctan(-np.polyfit(x, z, 1)[0])) - SLOPE_DEG) < 0.3


def test_nothing_behind_a_crest_of_the_sine_is_seen() -> None:
    points = seen_of_the_sine(3)
    for hit in points.xyz[::20]:
        u = np.linspace(0.02, 0.98, 200)
        sight = SENSOR_M + u * (hit[2] - SENSOR_M)
        # The point's own noise turns its line of sight by as much.
        assert (sight > sine(u * hit[0]) - 4.0 * NOISE_M).all()


def test_the_kernels_figure_is_written(tmp_path: Path) -> None:
    study("carving-fig3")(tmp_path, quick=True, progress=lambda *_: None)
    rows = list(csv.DictReader((tmp_path / "kernel.csv").read_text().splitlines()))
    middle = next(row for row in rows if abs(float(row["distance_m"])) < 1e-9)
    assert float(middle["length_2_m"]) == 1.0
    assert (tmp_path / "kernel.png").stat().st_size > 0


@pytest.mark.long
def test_a_face_without_points_is_bounded_by_the_line_of_sight_over_its_edge(tmp_path: Path) -> None:
    study("carving-fig4")(tmp_path, quick=True, progress=lambda *_: None)
    (row,) = csv.DictReader((tmp_path / "chords.csv").read_text().splitlines())
    assert (float(row["face_deg"]), float(row["points_on_the_face"])) == (45.0, 0.0)
    # The upper surface undershoots lines of sight by some centimetres.
    assert abs(float(row["chord_deg"]) - float(row["sight_over_the_edge_deg"])) < 5.0
