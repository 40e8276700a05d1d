"""Run every case of bad input in a process of its own: ``python -m benchmarks.bad_input``.

A case passes when the command ends with exit code 2, 3, 4 or 5 and one sentence (usage errors may take
several lines), or with 0 where the input can be used, and the result is right where the case checks it. A traceback, exit code 1, a signal, more than 30 s
or more than 4 GB is a fault; so is success where a refusal was due. The time that a process waits for a processor
that others use does not count.
"""

import argparse
import contextlib
import io
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.bad_input.case import Case
from benchmarks.bad_input.damaged import damaged_cases
from benchmarks.bad_input.drives import drive_cases
from benchmarks.bad_input.good import GOOD, GOOD_COMMANDS
from benchmarks.bad_input.missions import mission_cases
from benchmarks.bad_input.odd_files import odd_cases
from benchmarks.bad_input.outlines import outline_cases
from benchmarks.bad_input.places import place_cases
from benchmarks.bad_input.rasters import raster_cases
from benchmarks.bad_input.settings import setting_cases
from benchmarks.bad_input.surveys import survey_cases
from benchmarks.bad_input.tables import table_cases
from benchmarks.bad_input.vectors import vector_cases
from benchmarks.writer import TABLES, Run

LONGEST_S, LARGEST_BYTES = 30.0, 4 * 10**9
_ADDRESS_SPACE_BYTES = 12 * 10**9
_REFUSED = {2, 3, 4, 5}
RESULT = TABLES / "bad_input.json"


def _in_child(case: Case, folder: Path) -> None:
    """Run a case in this forked process; never returns."""
    code = 99
    try:
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE_BYTES, _ADDRESS_SPACE_BYTES))
        case.prepare(folder)
        for name, number in (("out.log", 1), ("err.log", 2)):
            target = os.open(folder.parent / name, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
            os.dup2(target, number)
        sys.argv = ["firnline", *case.args]
        from firnline.cli.main import main

        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else (0 if end.code is None else 1)
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
        code = 98
    os._exit(code)


def run(case: Case, place: Path) -> dict[str, Any]:
    """Run a case; return its exit code, times, memory and words."""
    folder = place / "case"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for log in ("out.log", "err.log"):
        (place / log).unlink(missing_ok=True)
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        _in_child(case, folder)
    usage = _awaited(child, start)
    err = (place / "err.log").read_text(errors="replace") if (place / "err.log").exists() else ""
    out = (place / "out.log").read_text(errors="replace") if (place / "out.log").exists() else ""
    return {
        "code": usage[0],
        "wall_s": round(time.monotonic() - start - usage[2], 2),
        "peak_bytes": usage[1],
        "stderr": err.strip(),
        "wrong": _wrong(case, folder, out + err) if usage[0] == 0 else "",
    }


def _wrong(case: Case, folder: Path, printed: str) -> str:
    """Return what is wrong with the result of a command that succeeded."""
    if case.right is None:
        return ""
    try:
        return case.right(folder, printed)
    except Exception as error:  # a result that cannot be read is wrong, whatever the reason
        return f"{type(error).__name__}: {error}"


def _awaited(child: int, start: float) -> tuple[int, int, float]:
    """Return exit code, memory [bytes], and the time that the process has waited for a processor [s]."""
    starved_s = 0.0
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), usage.ru_maxrss * 1024, starved_s
        starved_s = max(_starved_s(child), starved_s)
        if time.monotonic() - start - starved_s > LONGEST_S:
            os.kill(child, signal.SIGKILL)
            _, _, usage = os.wait4(child, 0)
            return -signal.SIGKILL, usage.ru_maxrss * 1024, starved_s
        time.sleep(0.02)


def _starved_s(process: int) -> float:
    """Return how long a process has waited for a processor that others used [s]; 0 where that is not known."""
    try:
        return int(Path(f"/proc/{process}/schedstat").read_text().split()[1]) / 1e9
    except (OSError, IndexError):
        return 0.0


def verdict(case: Case, found: dict[str, Any]) -> str:
    """Return ``refused``, ``used``, or the kind of fault."""
    fault = _fault(found)
    if fault:
        return f"fault: {fault}"
    if (case.right or case.words) and "No such option" in found["stderr"]:
        return "fault: no such option"
    if found["code"] == 0:
        if found["wrong"]:
            return f"fault: wrong ({found['wrong'][:200]})"
        return "used" if case.may_succeed else "fault: accepted"
    if case.words and not any(word in found["stderr"] for word in case.words):
        return f"fault: words (the refusal names none of {', '.join(case.words)})"
    return "refused"


def _fault(found: dict[str, Any]) -> str:
    """Return what is wrong with the way in which a command ended, or nothing."""
    words, code = found["stderr"], found["code"]
    signs = {
        "too long": found["wall_s"] > LONGEST_S,
        "too much memory": found["peak_bytes"] > LARGEST_BYTES,
        "traceback": "Traceback" in words,
        f"exit {code}": code not in {0, *_REFUSED},
        "no sentence": code in _REFUSED - {2} and not _is_sentence(words),
    }
    return next((sign for sign, is_so in signs.items() if is_so), "")


def _is_sentence(words: str) -> bool:
    """Return whether the last line is firnline's one sentence; notes and warnings may stand before it."""
    last = words.splitlines()[-1] if words else ""
    return bool(re.fullmatch(r"firnline: .{20,}[.?]", last))


def main() -> None:
    """Run all cases, print the faults, and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="run cases whose name contains this")
    parser.add_argument("--show", action="store_true", help="print every refusal")
    parser.add_argument("--workers", type=int, default=2, help="cases that run at once")
    given = parser.parse_args()
    run = Run.begin(main, RESULT)
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[variable] = "1"
    _warm_up()
    cases = [c for c in all_cases() if given.only in c.name]
    counts: Counter[str] = Counter()
    faults, slowest, largest = [], 0.0, 0
    for case, found in _found(cases, given.workers):
        kind = verdict(case, found)
        counts[kind.split(" (")[0]] += 1
        slowest, largest = max(slowest, found["wall_s"]), max(largest, found["peak_bytes"])
        if kind.startswith("fault"):
            faults.append(
                {"case": case.name, "kind": kind, "code": found["code"], "words": found["stderr"][-400:]}
            )
        if kind.startswith("fault") or given.show:
            print(f"{kind}  [{case.name}] {found['wall_s']} s  {found['stderr'][-300:]}", flush=True)
    table = {
        "cases": len(cases),
        "counts": dict(sorted(counts.items())),
        "slowest_s": slowest,
        "largest_gb": round(largest / 1e9, 2),
        "faults": faults,
    }
    print(json.dumps({**table, "faults": len(faults)}, indent=2))
    if not given.only:
        run.write(table)
    sys.exit(bool(faults))


def _found(cases: Sequence[Case], n_workers: int) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Run all cases in so many processes at once, and yield what each gave."""
    workers = get_context("fork").Pool(n_workers, _set_cases, (cases,))
    with workers:
        for number, found in workers.imap_unordered(_run_number, range(len(cases))):
            yield cases[number], found


_CASES: list[Case] = []


def _set_cases(cases: Sequence[Case]) -> None:
    """Store the cases of a worker; they hold functions, which cannot be sent to it."""
    _CASES[:] = cases


def _run_number(number: int) -> tuple[int, dict[str, Any]]:
    with tempfile.TemporaryDirectory() as place:
        return number, run(_CASES[number], Path(place))


def all_cases() -> list[Case]:
    """Return all cases; their names are unique."""
    kinds = (
        *(raster_cases, vector_cases, table_cases, setting_cases, place_cases, odd_cases),
        *(outline_cases, mission_cases, survey_cases, drive_cases, damaged_cases),
    )
    cases = [case for cases_of in kinds for case in cases_of()]
    names = Counter(case.name for case in cases)
    assert max(names.values()) == 1, [name for name, n in names.items() if n > 1]
    return cases


def _warm_up() -> None:
    """Run commands on good input, so that a forked child finds everything imported."""
    from firnline.cli.main import app

    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        GOOD(Path(place))
        for command in GOOD_COMMANDS:
            with contextlib.redirect_stdout(io.StringIO()):
                _succeed(app, command)


def _succeed(app: Callable[..., object], command: list[str]) -> None:
    """Run a command in this process; any other exit code than 0, or 5 of a map class, is an error."""
    try:
        app(args=command)
    except SystemExit as ending:
        if ending.code not in (None, 0, 5):
            raise RuntimeError(
                f"firnline {' '.join(command)} ended with {ending.code}; 0 was expected."
            ) from ending


if __name__ == "__main__":
    main()
