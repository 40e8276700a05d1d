"""Monte Carlo: the same bytes whatever the engine, edited studies refused, and statistics that are right."""

import csv
import socket
import threading
from functools import cache, partial

import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib.figure import Figure

from benchmarks.small_inputs import SECOND_PATTERN
from benchmarks.small_inputs import STUDY as SMALL_STUDY
from sim.montecarlo import results
from sim.montecarlo.config import blocks_of, read_study
from sim.montecarlo.results import read_trials, statistics
from sim.montecarlo.study import RESULTS, run_study
from sim.montecarlo.trials import TrialTerrains, _localized, routes, survey_block
from survey import Dem, Grid, reconstruct
from survey.core.documents import read_record
from survey.core.errors import CapacityError, ConfigError, InputError
from survey.core.executors import run_all
from survey.reporting.rendering import picture_of

STUDY = "seed = 5\n" + SMALL_STUDY.replace("swaths = [2]", "swaths = [2, 3]") + SECOND_PATTERN


@pytest.fixture(autouse=True)
def drawn_once(monkeypatch):
    """Draw one picture of a study for all tests: the picture takes seven tenths of the time of a small study."""
    monkeypatch.setattr(results, "picture_of", lambda *_: picture())


@cache
def picture():
    return picture_of(Figure((6.0, 3.0)), "Curves", "Curves of a study.")


@pytest.fixture
def study(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    return read_study(tmp_path / "study.toml")


def small(tmp_path, text):
    (tmp_path / "study.toml").write_text(text)
    return read_study(tmp_path / "study.toml")


def tables(folder):
    return {name: (folder / name).read_bytes() for name in ("trials.parquet", "trials.csv", "summary.csv")}


def test_a_study_makes_tables_a_summary_and_a_page(study, tmp_path, monkeypatch):
    monkeypatch.setattr(results, "picture_of", picture_of)
    calls = []
    page = run_study(study, tmp_path / "out", engine="serial", watch=lambda *n: calls.append(n))
    table = pq.read_table(tmp_path / "out" / "trials.parquet")
    assert table.num_rows == 3 * 2 * 2
    assert calls[-1] == (3, 3)
    assert page.read_text().count("<figure") == 1
    with (tmp_path / "out" / "summary.csv").open() as file:
        rows = list(csv.DictReader(file))
    # The summary is that of the table, in the order of the study.
    assert [(row["planner"], int(row["swaths"])) for row in rows] == [
        (planner, n) for planner in ("lawnmower", "piecewise-continuous") for n in (2, 3)
    ]
    first = [r["rmse_m"] for r in table.to_pylist() if r["planner"] == "lawnmower" and r["swaths"] == 2]
    assert float(rows[0]["mean_rmse_m"]) == pytest.approx(np.mean(first))


def test_more_trials_change_none_of_those_there_were(study):
    (block,) = blocks_of(study)
    few = survey_block(study, block._replace(n=2))
    many = survey_block(study, block)
    # Matrices of another width may round differently in the last digits.
    for one, other in zip(few, [t for t in many if t.trial < 2], strict=True):
        assert one.rmse_m == pytest.approx(other.rmse_m, rel=1e-6)
        assert (one.family, one.length_scale_m) == (other.family, other.length_scale_m)


def test_smooth_terrain_is_mapped_better_by_more_swaths(study):
    (block,) = blocks_of(study)
    trials = [t for t in survey_block(study, block) if t.planner == "lawnmower"]
    two, three = (np.mean([t.rmse_m for t in trials if t.swaths == n]) for n in (2, 3))
    assert three < two


def test_any_reconstruction_and_fidelity_can_be_studied(tmp_path):
    text = STUDY.replace("trials = 3", 'trials = 1\nfidelity = "statistical"').replace("[2, 3]", "[2]")
    text += '[[maps]]\nname = "tin"\nmethod = "tin"\n'
    study = small(tmp_path, text)
    (block,) = blocks_of(study)
    lawnmower, steered = survey_block(study, block)
    assert lawnmower.map == steered.map == "tin"
    # Triangles end at the hull of the landmarks, and the rest of the site is reported as silent.
    assert 0.0 <= lawnmower.silent_share < 0.5
    assert lawnmower.n_samples > 100


def test_landmarks_are_mapped_as_one_estimate_with_the_path_by_default(tmp_path):
    text = STUDY[: STUDY.index('[[planners]]\npattern = "piecewise')].replace("[2, 3]", "[2]")
    text = text.replace("trials = 3", 'trials = 1\nfidelity = "statistical"')
    gp = "[maps.gp]\nfit = false\nvariance_m2 = 36.0\nlength_scale_m = 80.0\n"
    for how in ("joint", "inflated", "independent"):
        text += f'[[maps]]\nname = "{how}"\nmethod = "gp"\nlandmark_errors = "{how}"\n{gp}'
    study = small(tmp_path, text)
    (block,) = blocks_of(study)
    claimed = {trial.map: trial.claimed_m for trial in survey_block(study, block)}
    # One estimate claims what mission and `reconstruct` with the path claim; more landmarks do not mend the path.
    assert claimed["independent"] < claimed["joint"]
    world = TrialTerrains(study, block)
    (driven,) = routes(world, study.designs[0])
    trajectory, points = _localized(world, driven, 0)
    result = reconstruct(points, world.nodes, config=study.maps[0].gp, path=trajectory.error)
    assert claimed["joint"] == pytest.approx(np.sqrt(np.mean(result.std.elevation**2)))


def test_terrain_around_a_real_prior_agrees_with_it(tmp_path, rng):
    coarse = Dem.on(Grid((37.5, 37.5, 337.5, 337.5), 75.0), 20.0 * rng.random((5, 5)))
    coarse.write(tmp_path / "prior.tif")
    kind = '[[terrains]]\nsource = "conditional"\nname = "real"\nfile = "prior.tif"\nsigma_m = 0.1\n'
    text = STUDY[: STUDY.index("[[terrains]]")] + kind + STUDY[STUDY.index("[[planners]]") :]
    study = small(tmp_path, text.replace("trials = 3", "trials = 2"))
    from sim.montecarlo.trials import generate_terrain

    one, other = (generate_terrain(study, study.terrains[0], trial) for trial in range(2))
    # The middle cell's mean is kept to its stated error; between the cells the draws differ.
    for dem in (one, other):
        assert dem.window((150.0, 150.0, 225.0, 225.0)).elevation.mean() == pytest.approx(
            coarse.at([[187.5, 187.5]])[0], abs=1.0
        )
    assert np.abs(one.elevation - other.elevation).max() > 0.1


@pytest.mark.parametrize("engine", ["serial", "processes"])
def test_engines_give_the_same_results_for_every_piece(engine):
    assert dict(run_all(partial(pow, 3), [0, 1, 2, 3, 4], engine=engine, workers=2)) == {
        0: 1,
        1: 3,
        2: 9,
        3: 27,
        4: 81,
    }


def test_a_study_edited_between_two_runs_is_refused_by_name(study, tmp_path):
    run_study(study, tmp_path / "out", engine="serial")
    edited = small(tmp_path, STUDY.replace("length_scale_m = 80.0", "length_scale_m = 90.0"))
    with pytest.raises(ConfigError, match=r"terrains.0.length_scale_m = 80.0, and now it is 90.0"):
        run_study(edited, tmp_path / "out", engine="serial")
    before = tables(tmp_path / "out")
    run_study(study, tmp_path / "out", engine="serial")
    assert tables(tmp_path / "out") == before


def test_trials_of_other_versions_are_not_continued(study, tmp_path, monkeypatch):
    run_study(study, tmp_path / "out", engine="serial")
    monkeypatch.setattr("sim.mission.runs.current_versions", lambda: {"numpy": "3.0"})
    run_study(study, tmp_path / "out", engine="serial")  # no trial is left to do
    monkeypatch.setattr("sim.montecarlo.config._TOGETHER", {"ideal": 2})
    blocks = tmp_path / "out" / "blocks"
    (blocks / "000-0000000.parquet").rename(blocks / "000-0000002.parquet")  # one of two blocks is there
    with pytest.raises(InputError, match="may give other bytes; do all trials again with --fresh"):
        run_study(study, tmp_path / "out", engine="serial")


def test_no_flipped_bit_of_a_study_reads_as_other_trials(study, tmp_path):
    run_study(study, tmp_path / "out", engine="serial")
    (block,) = (tmp_path / "out" / "blocks").glob("*.parquet")
    for file in (block, tmp_path / "out" / "trials.parquet"):
        right, stored = read_trials(file), file.read_bytes()
        for bit in np.random.default_rng(1).choice(8 * len(stored), 150, replace=False):
            damaged = bytearray(stored)
            damaged[bit // 8] ^= 1 << (bit % 8)
            file.write_bytes(bytes(damaged))
            try:
                assert read_trials(file).equals(right)
            except InputError:
                continue
        file.write_bytes(stored)


def test_the_record_of_a_study_covers_every_result(study, tmp_path):
    run_study(study, tmp_path / "out", engine="serial")
    listed = read_record(tmp_path / "out")["files_sha256"]
    assert set(listed) == {*RESULTS, "figures/00-error.png"} - {"figures", "made.json"}
    (tmp_path / "out" / "summary.csv").write_text("terrain,planner\n")
    with pytest.raises(InputError, match=r"summary\.csv is missing or was changed"):
        read_record(tmp_path / "out")


def test_a_changed_beginning_of_a_study_is_refused(study, tmp_path):
    run_study(study, tmp_path / "out", engine="serial")
    begun = (tmp_path / "out" / "study.json").read_text()
    (tmp_path / "out" / "study.json").write_text(begun.replace('"seed": 5', '"seed": 6'))
    with pytest.raises(InputError, match=r"study\.json was changed"):
        run_study(study, tmp_path / "out", engine="serial")
    run_study(study, tmp_path / "out", engine="serial", fresh=True)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("trials = 3", "trials = 1000000000000", "set trials to at most 25000000"),
        ("map_step_m = 25.0", "map_step_m = 0.001", "set it to 0.201 or more"),
        ("size_m = 200.0", "size_m = 200.0\nstep_m = 0.001", "step_m = 0.0245 or more"),
    ],
)
def test_a_study_that_does_not_fit_is_refused_before_the_first_trial(tmp_path, old, new, words):
    with pytest.raises(CapacityError, match=words):
        run_study(small(tmp_path, STUDY.replace(old, new)), tmp_path / "out", engine="serial")
    assert not (tmp_path / "out").exists()


def test_a_damaged_block_is_named(study, tmp_path):
    run_study(study, tmp_path / "out", engine="serial")
    (block,) = (tmp_path / "out" / "blocks").glob("*.parquet")
    block.write_bytes(block.read_bytes()[:-20])
    with pytest.raises(InputError, match=block.name):
        run_study(study, tmp_path / "out", engine="serial")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("lawnmower", "lawnmover", "planners.0: the planner 'lawnmover' is not known; one of lawnmower"),
        ("trials = 3", "trials = 0", "trials: input should be greater than 0"),
        ("swaths = [2, 3]", "", "planners.0 has no size"),
        ("size_m", "sise_m", "did you mean size_m"),
        ("[[planners]]", "[[planners]]\nswat = 3", "swat is not known; did you mean swaths?"),
        ("piecewise-continuous", "lawnmower", "same label"),
    ],
)
def test_a_wrong_study_is_refused_in_one_sentence(tmp_path, old, new, words):
    with pytest.raises(ConfigError) as refusal:
        small(tmp_path, STUDY.replace(old, new))
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_scheduler_that_is_not_there_is_named():
    pytest.importorskip("distributed")
    # Port 9 of this machine (discard) has no listener.
    with pytest.raises(InputError, match=r"no dask scheduler answers at tcp://127.0.0.1:9"):
        list(run_all(partial(pow, 3), [1], engine="dask", scheduler="tcp://127.0.0.1:9"))
    with pytest.raises(ConfigError, match="no scheduler's address"):
        list(run_all(partial(pow, 3), [1], engine="dask", scheduler="nowhere"))


def greet(listener, words):
    with listener.accept()[0] as peer:
        peer.sendall(words)


def test_a_listener_that_is_no_scheduler_is_refused(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("survey.core.executors._REACH_S", 0.5)
    # One that waits to be spoken to, as a web server does, and one that speaks another tongue.
    for words, reason in ((b"", "no dask scheduler answers"), (b"220 mail.example", "is no dask scheduler")):
        with socket.create_server(("127.0.0.1", 0)) as listener:
            greeter = threading.Thread(target=greet, args=(listener, words))
            if words:
                greeter.start()
            address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
            with pytest.raises(InputError, match=reason):
                list(run_all(partial(pow, 3), [1], engine="dask", scheduler=address))
            if words:
                greeter.join()


def test_statistics_are_those_of_the_trials():
    rmse = np.array([0.1, 0.2, 0.3, 0.6])
    values = {"rmse_m": rmse, "length_m": 0 * rmse, "claimed_m": rmse, "silent_share": 0 * rmse}
    row = statistics(values, 0.4572, ["here"])
    assert row["mean_rmse_m"] == pytest.approx(0.3)
    assert row["pass_share"] == 0.75
    assert row["pooled_rmse_m"] == pytest.approx(np.sqrt(np.mean(rmse**2)))
    # Of four values, resampled means lie between the least and the greatest, about the mean.
    assert 0.1 <= row["mean_rmse_m_low"] < 0.3 < row["mean_rmse_m_high"] <= 0.6
