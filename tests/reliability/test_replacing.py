"""Commands that replace their output are killed at random: what is there afterwards is the old output or the new.

The suite kills one command of each way to replace: files one by one, a pair of files, a folder, a stage of a run.
"""

from functools import cache

import pytest

from benchmarks.replacing_kills import COMMANDS, OUTCOMES, Command, Trial, kills, prepared, succeed

N_KILLS = 3
"""One in each phase; ``benchmarks.replacing_kills`` kills each command 50 times."""
IN_SUITE = ("plan", "export", "reconstruct", "run --fresh")
EVERY = [name if name in IN_SUITE else pytest.param(name, marks=pytest.mark.exhaustive) for name in COMMANDS]
pytestmark = [pytest.mark.reliability, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("replacing")


@pytest.fixture(scope="module")
def server(place):
    with prepared(place) as server:
        yield server


@pytest.fixture(scope="module")
def trial_of(server, place):
    """Return the trial of a command by its name, with the outputs of both variants."""
    return cache(lambda name: Trial(server, place, COMMANDS[name]))


@pytest.mark.long
@pytest.mark.parametrize("name", EVERY)
def test_a_command_killed_while_it_replaces_leaves_the_old_output_or_the_new(trial_of, name):
    counts = kills(trial_of(name), name, N_KILLS)
    assert counts["other output"] == 0
    assert sum(counts[outcome] for outcome in OUTCOMES) == N_KILLS


def test_a_command_that_ends_with_an_error_before_the_kill_is_a_fault(server, place):
    with pytest.raises(RuntimeError, match="ended with the status"):
        succeed(server, "plan no_area.gpkg -q")
    trial = Trial(server, place, Command(("init mine.toml --force",) * 2, ("mine.toml",)))
    trial.command = Command(("init mine.toml",) * 2, ("mine.toml",))  # refused without --force
    with pytest.raises(RuntimeError, match="0 was expected"):
        trial.kill(0, 100.0)


@pytest.mark.long  # shares the outputs that the others replace
def test_a_companion_may_be_absent_but_not_belong_to_another_output(trial_of):
    trial = trial_of("plan")
    before, new = trial.outputs
    assert before.keys() == new.keys() == {"route.geojson", "route.png"}
    assert trial.outcome({"route.geojson": before["route.geojson"]}, 0, 1) == "companion absent"
    assert trial.outcome({"route.png": before["route.png"]}, 0, 1) == "other output"
    mixed = {"route.geojson": before["route.geojson"], "route.png": new["route.png"]}
    assert trial.outcome(mixed, 0, 1) == "other output"


@pytest.mark.long
@pytest.mark.parametrize("name", EVERY)
def test_both_variants_write_the_same_files_with_different_content_but_for_runs_and_studies(trial_of, name):
    before, new = trial_of(name).outputs
    assert before.keys() == new.keys()
    assert (before == new) == (name == "reproduce" or bool(COMMANDS[name].run))
