"""What a command used, as the benchmark of maps in tiles counts it."""

import subprocess
import sys

import numpy as np
import pytest

from benchmarks.whole_glacier.mapping import used_by


def test_the_memory_of_a_command_does_not_begin_with_that_of_the_process_that_measures():
    own = np.ones(25_000_000)
    used = used_by([sys.executable, "-S", "-c", "x = bytearray(30_000_000)"])
    assert 30.0 < used.memory_mb < 150.0 < own.nbytes / 1e6


def test_a_command_that_fails_is_said():
    with pytest.raises(subprocess.CalledProcessError):
        used_by([sys.executable, "-S", "-c", "raise SystemExit(3)"])
