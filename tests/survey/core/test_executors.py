"""Workers that stay between two pieces of work."""

import os
import signal

import pytest

from survey.core.errors import ConfigError
from survey.core.executors import open_workers, run_all

OWN_NUMBER = ["/proc/self"]
"""A link whose target is the number of the process that reads it."""


def test_workers_stay_until_the_block_ends_and_dead_ones_are_replaced() -> None:
    with open_workers("processes", 1) as run:
        numbers = [dict(run(os.readlink, OWN_NUMBER))["/proc/self"] for _ in range(2)]
        assert numbers[0] == numbers[1] != str(os.getpid())
        os.kill(int(numbers[0]), signal.SIGKILL)
        assert dict(run(os.readlink, OWN_NUMBER))["/proc/self"] != numbers[0]


def test_the_serial_engine_runs_in_this_process() -> None:
    assert dict(run_all(os.readlink, OWN_NUMBER, engine="serial")) == {"/proc/self": str(os.getpid())}


def test_less_than_one_worker_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least 1 is needed"), open_workers("processes", 0):
        pass
