"""Commands of which a worker, all processes or the scheduler are killed while they make a map in tiles."""

import hashlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_POLL_S = 0.05


def digest(folder: Path) -> str:
    """Return a digest of all files of a map."""
    found = hashlib.sha256()
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            found.update(str(file.relative_to(folder)).encode())
            found.update(file.read_bytes())
    return found.hexdigest()


def n_stored(out: Path) -> int:
    """Return the number of pieces of a map that are stored."""
    done = ("work/sorted/f*", "work/cells/*.npy", "work/summaries/*.npz", "work/withheld/*.npz")
    return sum(1 for pattern in done for _ in out.glob(pattern))


def workers_of(pid: int) -> list[int]:
    """Return the worker processes of a command, as far as they live."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(status.read_text().rsplit(")", 1)[1].split()[1])
            line = (status.parent / "cmdline").read_bytes()
        except (OSError, IndexError):
            continue
        if parent == pid and b"spawn_main" in line:
            found.append(int(status.parent.name))
    return sorted(found)


def workers_killed(arguments: list[str], out: Path, n: int) -> int:
    """Run a command of which a worker is killed whenever a piece was stored; return how often."""
    process = _started(arguments)
    n_kills, done = 0, 0
    while process.poll() is None:
        workers = workers_of(process.pid)
        if n_kills < n and workers and n_stored(out) > done:
            done = n_stored(out)
            os.kill(workers[n_kills % len(workers)], signal.SIGKILL)
            n_kills += 1
        time.sleep(_POLL_S)
    _require_success(process, arguments)
    return n_kills


def command_killed(arguments: list[str], out: Path, n: int) -> int:
    """Run a command that is killed with its workers whenever a piece was stored, and begun again; return how often."""
    for n_kills in range(n + 1):
        process, done = _started(arguments), n_stored(out)
        while process.poll() is None and (n_kills == n or n_stored(out) == done):
            time.sleep(_POLL_S)
        if process.poll() is not None:
            _require_success(process, arguments)
            return n_kills
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return n


def scheduler_killed(arguments: list[str], out: Path, address: str, n: int) -> int:
    """Run a command on a dask cluster whose scheduler is killed when some pieces are stored; return its exit code."""
    with dask_cluster(address, 2) as scheduler:
        process = _started(arguments)
        while process.poll() is None and n_stored(out) < n:
            time.sleep(_POLL_S)
        scheduler.kill()
        return process.wait()


@contextmanager
def dask_cluster(address: str, n_workers: int) -> Iterator["subprocess.Popen[bytes]"]:
    """Start a scheduler and workers in processes of this machine, yield the scheduler, and end them."""
    host, port = address.removeprefix("tcp://").split(":")
    parts = [("scheduler", "--host", host, "--port", port)]
    parts += [("worker", address, "--nthreads", "1", "--no-nanny")] * n_workers
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{name}", *options, "--no-dashboard"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for name, *options in parts
    ]
    try:
        _wait_for(host, int(port))
        yield processes[0]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def free_address() -> str:
    """Return an address of this machine at which nothing listens."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return f"tcp://127.0.0.1:{listener.getsockname()[1]}"


def _wait_for(host: str, port: int) -> None:
    """Wait until a port answers."""
    while True:
        try:
            socket.create_connection((host, port), timeout=1.0).close()
        except OSError:
            time.sleep(_POLL_S)
            continue
        return


def _started(arguments: list[str]) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def _require_success(process: "subprocess.Popen[bytes]", arguments: list[str]) -> None:
    if process.returncode != 0:
        raise subprocess.CalledProcessError(process.returncode, arguments)
