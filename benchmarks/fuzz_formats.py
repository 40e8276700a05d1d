"""Damage files of every format at random: ``python -m benchmarks.fuzz_formats --seconds 600``.

Reading may give an answer or a refusal of one sentence; any other exception, a crash of the process, a read
of more than ten seconds or memory beyond 2 GB is a finding.  Cases are numbered, and come again by number.
With ``--real FOLDER …`` files of other programs are damaged instead of our own (`benchmarks.foreign_files`).
A library that never comes back is seen by the case that stays in the file ``at``; over dem.nc 3069 HDF5 would,
were NetCDF files not read by a process with a time limit first.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.foreign_files import READERS, made, real_files
from benchmarks.format_samples import SAMPLES, mutated, put
from survey.core.errors import FirnlineError

SLOWEST_S = 10.0
LARGEST_BYTES = 2 * 10**9
# The process that reads may not take the machine's memory with it.
_ADDRESS_SPACE_BYTES = 8 * 10**9


def outcome(
    name: str, whole: bytes, seed: int, folder: Path, read: Callable[[Path], object] | None = None
) -> str:
    """Read one damaged file; return ``answer``, ``refused``, or what went wrong."""
    path = folder / name
    put(path, mutated(whole, np.random.default_rng(seed)))
    start = time.process_time()
    try:
        (read or SAMPLES[name].read)(path)
        found = "answer"
    except FirnlineError as refusal:
        found = (
            "refused" if "\n" not in str(refusal) and len(str(refusal)) > 20 else f"no sentence: {refusal!r}"
        )
    except BaseException as fault:  # that is what is looked for
        if isinstance(fault, KeyboardInterrupt):
            raise
        found = f"{type(fault).__name__}: {fault}"
    seconds = time.process_time() - start
    return found if seconds < SLOWEST_S else f"slow: {seconds:.0f} s"


def run(
    seconds: float, first: int, progress: Path | None = None, real: Sequence[Path] = ()
) -> tuple[Counter[str], list[str], int]:
    """Damage one format after the other until time is up; return counts, findings and the next number."""
    counts: Counter[str] = Counter()
    findings: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        wholes, readers = {}, {}
        if real:
            made(folder)
            files = real_files((*real, folder))
            wholes = {f"{number}-{file.name}": file.read_bytes() for number, file in enumerate(files)}
            readers = {name: READERS[Path(name).suffix.lower()] for name in wholes}
            print(f"{len(wholes)} files of other programs", file=sys.stderr)
        for name, sample in () if real else SAMPLES.items():
            sample.write(folder / name)
            wholes[name] = (folder / name).read_bytes()
        end, seed = time.monotonic() + seconds, first
        while time.monotonic() < end:
            for name, whole in wholes.items():
                if progress is not None:
                    progress.write_text(f"{name} {seed}")
                found = outcome(name, whole, seed, folder, readers.get(name))
                counts[found if found in ("answer", "refused") else "finding"] += 1
                if found not in ("answer", "refused"):
                    findings.append(f"{name} {seed}: {found[:300]}")
            seed += 1
    return counts, findings, seed


def supervised(seconds: float, first: int, real: Sequence[Path]) -> dict[str, object]:
    """Run in a process of its own, begun again behind a case that kills it."""
    end, seed = time.monotonic() + seconds, first
    total: Counter[str] = Counter()
    findings: list[str] = []
    largest = 0
    while (left := end - time.monotonic()) > 1.0:
        with tempfile.TemporaryDirectory() as place:
            progress, report = Path(place) / "at", Path(place) / "report.json"
            command = [
                sys.executable,
                "-W",
                "ignore",
                "-m",
                "benchmarks.fuzz_formats",
                "--child",
                str(report),
            ]
            command += ["--seconds", f"{left:.0f}", "--first", str(seed), "--at", str(progress)]
            command += ["--real", *map(str, real)] if real else []
            code = subprocess.run(command, check=False, stderr=subprocess.DEVNULL).returncode
            if report.exists():
                content = json.loads(report.read_text())
                total.update(content["counts"])
                findings += content["findings"]
                seed, largest = content["next"], max(largest, content["largest_bytes"])
            else:
                at = progress.read_text()
                findings.append(f"{at}: the process died with code {code}")
                seed = int(at.split()[1]) + 1
    return {"counts": dict(total), "findings": findings, "next": seed, "largest_bytes": largest}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument(
        "--real", type=Path, nargs="+", default=[], help="folders with files of other programs"
    )
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--at", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.child is None:
        print(json.dumps(supervised(chosen.seconds, chosen.first, chosen.real), indent=2))
        return
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE_BYTES, _ADDRESS_SPACE_BYTES))
    counts, findings, following = run(chosen.seconds, chosen.first, chosen.at, chosen.real)
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if largest > LARGEST_BYTES:
        findings.append(f"memory: {largest / 1e9:.1f} GB")
    report = {"counts": dict(counts), "findings": findings, "next": following, "largest_bytes": largest}
    chosen.child.write_text(json.dumps(report))


if __name__ == "__main__":
    main()
