"""A Monte Carlo that is killed again and again ends with the same bytes."""

import os
import resource
import signal
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.small_inputs import SECOND_PATTERN
from benchmarks.small_inputs import STUDY as SMALL_STUDY
from benchmarks.whole_glacier.kills import workers_of
from firnline.cli.main import app
from sim.montecarlo.config import blocks_of, read_study
from sim.montecarlo.study import run_study
from sim.montecarlo.trials import survey_block
from survey.core.executors import run_on_dask
from survey.core.streams import stream

STUDY = (
    "seed = 5\n"
    + SMALL_STUDY.replace("trials = 3", "trials = {trials}").replace("[2]", "[2, 3]")
    + SECOND_PATTERN
)
MONTECARLO = (sys.executable, "-m", "firnline.cli.main", "montecarlo", "s.toml", "--runs", "runs", "-q")
TABLES = ("trials.parquet", "trials.csv", "summary.csv", "minimum_swaths.csv", "index.html")


def started(folder: Path) -> subprocess.Popen[bytes]:
    """Start the study in two processes."""
    command = [*MONTECARLO, "--workers", "2"]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in TABLES}


def killed_again_and_again(folder: Path, n_kills: int) -> tuple[int, int]:
    """Kill parent or a worker at random moments until so many died, then let the study end; count both kinds."""
    rng = stream(1, "kills")
    n_parents, n_workers = 0, 0
    study = started(folder)
    while n_parents + n_workers < n_kills:
        time.sleep(float(rng.uniform(0.2, 4.0)))
        assert study.poll() is None, "the study ended before it was killed; give it more trials"
        workers = workers_of(study.pid)
        if rng.random() < 0.5 or not workers:
            study.kill()
            study.communicate()
            n_parents += 1
            study = started(folder)
        else:
            os.kill(workers[int(rng.integers(len(workers)))], signal.SIGKILL)
            n_workers += 1
    _, words = study.communicate()
    assert study.returncode == 0, words.decode()
    return n_parents, n_workers


def undisturbed(folder: Path) -> dict[str, bytes]:
    run_study(read_study(folder / "s.toml"), folder / "quiet", engine="serial")
    return bytes_of(folder / "quiet")


@pytest.mark.long
@pytest.mark.reliability
@pytest.mark.timeout(3600)  # every kill costs a start
@pytest.mark.parametrize(
    ("n_kills", "trials"), [(1, 60), pytest.param(20, 1500, marks=pytest.mark.exhaustive)]
)
def test_killed_parents_and_workers_change_no_byte(tmp_path, n_kills, trials):
    (tmp_path / "s.toml").write_text(STUDY.format(trials=trials))
    killed_again_and_again(tmp_path, n_kills)
    assert bytes_of(tmp_path / "runs" / "small") == undisturbed(tmp_path)


@pytest.mark.long
@pytest.mark.reliability
@pytest.mark.filterwarnings("ignore")  # dask and tornado warn while their workers are being killed
@pytest.mark.parametrize(
    ("killed_after", "trials"), [((1,), 50), pytest.param((1, 3), 300, marks=pytest.mark.exhaustive)]
)
def test_a_cluster_whose_workers_die_gives_the_same_trials(tmp_path, killed_after, trials):
    distributed = pytest.importorskip("distributed")
    (tmp_path / "s.toml").write_text(STUDY.format(trials=trials))
    study = read_study(tmp_path / "s.toml")
    blocks = blocks_of(study)
    expected = {block: survey_block(study, block) for block in blocks}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        results = {}
        for block, done in run_on_dask(client, partial(survey_block, study), blocks):
            results[block] = done
            if len(results) in killed_after:
                (victim, *_) = client.run(os.getpid).values()
                os.kill(victim, signal.SIGKILL)
    assert results == expected


@pytest.mark.long
@pytest.mark.reliability
@pytest.mark.filterwarnings("ignore")  # tornado warns of the connection that breaks off
def test_a_scheduler_that_dies_is_named(tmp_path):
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    place = ["--port", str(port), "--host", "127.0.0.1"]
    cluster = [
        subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{part}", *arguments, "--no-dashboard"],
            stderr=subprocess.DEVNULL,
        )
        for part, arguments in (("scheduler", place), ("worker", [address, "--nthreads", "1"]))
    ]
    (tmp_path / "s.toml").write_text(STUDY.format(trials=5000))
    command = [*MONTECARLO, "--scheduler", address]
    try:
        while not list((tmp_path / "runs").rglob("*.parquet")):
            study = subprocess.Popen(
                command,
                cwd=tmp_path,
                stderr=subprocess.PIPE,
                text=True,
            )
            while study.poll() is None and not list((tmp_path / "runs").rglob("*.parquet")):
                time.sleep(0.1)
        cluster[0].kill()
        _, err = study.communicate()
    finally:
        for process in cluster:
            process.kill()
            process.wait()
    assert study.returncode == 3
    assert err == (
        f"firnline: the dask scheduler at {address} stopped answering; start it again and run the same command, "
        "which continues from what is stored.\n"
    )


@pytest.mark.reliability
def test_a_full_disk_is_refused_and_the_study_goes_on_afterwards(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(STUDY.format(trials=50))

    command = [*MONTECARLO[3:], "--engine", "serial"]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        result = CliRunner().invoke(app, command)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert result.exit_code == 3, result.stderr
    assert "free space" in result.stderr
    assert CliRunner().invoke(app, command).exit_code == 0
