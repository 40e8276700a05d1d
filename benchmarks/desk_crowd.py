"""Two desks that write one plan and are killed, and many windows of one desk.

``python -m benchmarks.desk_crowd PLAN FIRST N`` sets N stakes, one an edit, and prints the number of each when it is stored.
"""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from desk.plan.document import PlanDocument
from desk.plan.history import OutdatedError
from desk.plan.history_file import StoredHistory, read_history


def set_stakes(file: Path, first: int, n: int) -> Iterator[int]:
    """Set stakes whose easting is their number, and yield each number once its edit is stored.

    An edit that is refused because another desk changed the plan is sent again for the changed plan.
    """
    store = StoredHistory(file, PlanDocument(), "site.tif")
    for number in range(first, first + n):
        while True:
            stakes = (*store.document.stakes, (float(number), 0.0))
            try:
                store.edit(
                    store.revision, "Set a stake", store.document.model_copy(update={"stakes": stakes})
                )
                break
            except OutdatedError:
                continue
        yield number


def lost_edits(file: Path, n_edits: int, n_kills: int) -> tuple[int, int]:
    """Let two processes edit one plan, kill one of them at random times, and count.

    Returns: the numbers of edits that were stored, and of those whose stake the plan does not hold.
    """
    rng, stored = np.random.default_rng(1), set[int]()
    first = {0: 0, 1: 10 * n_edits}
    n_round = max(1, n_edits // (n_kills + 1))
    for _ in range(n_kills + 1):
        desks = {k: _desk(file, first[k], n_round) for k in first}
        with ThreadPoolExecutor(2) as pool:
            reading = {k: pool.submit(_numbers, desk) for k, desk in desks.items()}
            time.sleep(float(rng.uniform(0.5, 1.5)))
            desks[int(rng.integers(2))].kill()
            for k, one in reading.items():
                found = one.result()
                stored.update(found)
                first[k] += n_round + 1
    held = {int(x) for x, _ in read_history(file).document.stakes}
    return len(stored), len(stored - held)


def _desk(file: Path, first: int, n: int) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "benchmarks.desk_crowd", str(file), str(first), str(n)]
    root = Path(__file__).resolve().parents[1]
    return subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, text=True)


def _numbers(desk: "subprocess.Popen[str]") -> list[int]:
    """Return the numbers that a process printed to the end of their lines."""
    text, _ = desk.communicate()
    return [int(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]


def others_wait_s(address: str, log: Path, n: int) -> tuple[float, list[str]]:
    """Ask a desk while n windows ask, n follow a job, and n requests arrive in part.

    `log`: empty log of a drive beside the plan, which the job follows. Returns: 95th percentile of the time to an answer
    [s], and the kinds of request that were answered wrongly.
    """
    import httpx

    origin = address.split("/?", maxsplit=1)[0]
    host, port = origin.removeprefix("http://").split(":")
    with (
        httpx.Client(timeout=120.0, limits=httpx.Limits(max_connections=None)) as client,
        ExitStack() as held,
    ):
        client.get(address).raise_for_status()
        # The folder of the plan is there once it is opened.
        client.get(f"{origin}/api/site").raise_for_status()
        log.touch()
        job = client.post(f"{origin}/api/jobs", json={"kind": "watch"}, headers={"origin": origin}).json()[
            "job"
        ]
        statuses = []
        for k in range(n):
            stream = held.enter_context(client.stream("GET", f"{origin}/api/jobs/{job}/events"))
            statuses.append(stream.status_code)
            half = held.enter_context(socket.create_connection((host, int(port))))
            half.sendall(b"GET / HTTP/1.1\r\n" if k % 2 else _unfinished(origin, client))
        wrong = [] if set(statuses) <= {200, 429} else ["streams"]
        if client.get(f"{origin}/api/export/UNKNOWN").status_code != 422:
            wrong.append("an unknown kind of file")

        def asked(k: int) -> float:
            began = time.perf_counter()
            path = ("/api/plan", "/api/site", "/tiles/relief/0/0/0.png")[k % 3]
            client.get(origin + path).raise_for_status()
            return time.perf_counter() - began

        with ThreadPoolExecutor(n) as pool:
            waits = list(pool.map(asked, range(6 * n)))
        client.delete(f"{origin}/api/jobs/{job}", headers={"origin": origin})
    return float(np.percentile(waits, 95)), wrong


def _unfinished(origin: str, client: Any) -> bytes:
    """Return a request whose body does not come."""
    cookies = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
    head = {
        "host": origin.removeprefix("http://"),
        "origin": origin,
        "cookie": cookies,
        "content-length": "1000",
    }
    return (
        "POST /api/edit HTTP/1.1\r\n" + "".join(f"{k}: {v}\r\n" for k, v in head.items()) + "\r\n{"
    ).encode()


if __name__ == "__main__":
    for stored_number in set_stakes(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])):
        print(json.dumps(stored_number), flush=True)
