"""Workers that stay between two pieces of work."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from survey.core.errors import ConfigError, InputError
from survey.core.executors import open_workers, run_all

OWN_NUMBER = ["/proc/self"]
"""A link whose target is the number of the process that reads it."""


def test_workers_stay_until_the_block_ends_and_dead_ones_are_replaced() -> None:
    with open_workers("processes", 1) as run:
        numbers = [dict(run(os.readlink, OWN_NUMBER))["/proc/self"] for _ in range(2)]
        assert numbers[0] == numbers[1] != str(os.getpid())
        os.kill(int(numbers[0]), signal.SIGKILL)
        assert dict(run(os.readlink, OWN_NUMBER))["/proc/self"] != numbers[0]


def _hindered_once(folder: Path, piece: str) -> str:
    """Die, or wait for a minute and refuse to end; a second time return at once."""
    marker = folder / piece
    if not marker.exists():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        marker.touch()
        while piece == "waits" or not (folder / "waits").exists():
            time.sleep(60.0 if piece == "waits" else 0.01)
        os.kill(os.getpid(), signal.SIGKILL)
    return piece


def test_a_worker_that_does_not_end_with_a_dead_one_is_killed(tmp_path: Path) -> None:
    done = run_all(partial(_hindered_once, tmp_path), ["waits", "dies"], workers=2)
    assert dict(done) == {"waits": "waits", "dies": "dies"}


def test_the_death_of_a_process_started_late_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = ProcessPoolExecutor._adjust_process_count

    def start_late(pool: ProcessPoolExecutor) -> None:
        time.sleep(0.5)  # the pool's manager thread goes on to wait for the processes that it knows
        start(pool)

    monkeypatch.setattr(ProcessPoolExecutor, "_adjust_process_count", start_late)
    done = run_all(partial(_hindered_once, tmp_path), ["waits", "dies"], workers=2)
    assert dict(done) == {"waits": "waits", "dies": "dies"}


def test_the_serial_engine_runs_in_this_process() -> None:
    assert dict(run_all(os.readlink, OWN_NUMBER, engine="serial")) == {"/proc/self": str(os.getpid())}


def test_less_than_one_worker_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least 1 is needed"), open_workers("processes", 0):
        pass


def test_a_script_that_starts_workers_without_a_guard_is_refused(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("from survey.core.executors import run_all\nlist(run_all(str, [1, 2], workers=2))\n")
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1] == (
        "survey.core.errors.InputError: the workers failed to start; new processes import the script that starts them: "
        'put its calls under `if __name__ == "__main__":`.'
    )


def test_a_new_process_that_imports_its_parents_script_makes_no_pool(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multiprocessing.current_process(), "_inheriting", True, raising=False)
    made: list[int] = []
    monkeypatch.setattr(ProcessPoolExecutor, "__init__", lambda *_: made.append(1))
    with pytest.raises(InputError, match="the workers failed to start"):
        list(run_all(str, [1, 2], workers=2))
    assert not made
