"""Maps in tiles that are killed again and again."""

import hashlib
import os
import signal
import subprocess
from pathlib import Path

import numpy as np


def digest(folder: Path) -> str:
    """Return a digest of all files of a map."""
    found = hashlib.sha256()
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            found.update(str(file.relative_to(folder)).encode())
            found.update(file.read_bytes())
    return found.hexdigest()


def killed(arguments: list[str], n: int, longest_s: float, seed: int) -> int:
    """Run a command that is killed with its workers up to n times after random times; return how often it was."""
    rng = np.random.default_rng(seed)
    n_kills = 0
    while True:
        process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, start_new_session=True)
        try:
            process.wait(rng.uniform(0.3, 1.0) * longest_s if n_kills < n else None)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            n_kills += 1
            continue
        if process.returncode != 0:
            raise subprocess.CalledProcessError(process.returncode, arguments)
        return n_kills
