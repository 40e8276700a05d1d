"""Kill every command that replaces its output: ``python -m benchmarks.replacing_kills --kills 50``.

Each command writes two outputs in turn, one over the other. A third of the kills comes at a random moment of
the command, a third after its first draft has appeared, and a third after its output has begun to change.
Afterwards the output is read as the commands read it. It has to be the output before or the output of the
command; a companion (a picture beside a route) may be absent, but never belong to another main file. Every stage
that a run lists has to hold the files that it listed. A command that ends before the kill has to succeed.
"""

import argparse
import hashlib
import random
import re
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.fork_server import ForkServer
from benchmarks.small_inputs import MISSION, STUDY, UTM
from benchmarks.writer import TABLES, Run, read_table
from survey import Dem, Grid, SurfacePoints, SurveyArea
from survey.core.files import existing_file
from survey.core.run_folder import RunFolder

RESULT = TABLES / "replacing_kills.json"
KILLED = 9
_POLL_S = 0.0005
OUTCOMES = ("output before", "new output", "companion absent", "other output")
PHASES = ("any time", "after the first draft", "after the first change")
Digests = Mapping[str, str]


class Command(NamedTuple):
    """A command that replaces its output: two variants with two outputs, and what the outputs are.

    ``companions`` describe the main output and may be absent. The output of a run is the same for both
    variants, because a run folder belongs to one mission; its stages are checked besides.
    """

    variants: tuple[str, str]
    outputs: tuple[str, ...]
    companions: tuple[str, ...] = ()
    run: str = ""


def _of(command: str, first: str, second: str, *outputs: str, companions: tuple[str, ...] = ()) -> Command:
    return Command((f"{command} {first}", f"{command} {second}"), outputs, companions)


def _run(command: str, run: str, *stages: str) -> Command:
    return Command((command, command), tuple(f"{run}/{stage}" for stage in stages), run=run)


_WITH_PAGE = ("trials.parquet", "trials.csv", "summary.csv", "minimum_swaths.csv", "figures", "made.json")
COMMANDS = {
    "init": _of("init mine.toml --force", "", "--dem dem.tif", "mine.toml"),
    "plan": _of(
        "plan area.gpkg -o route.geojson --force -q",
        "--swaths 3",
        "--swaths 4",
        "route.geojson",
        companions=("route.png",),
    ),
    "reconstruct": _of(
        "reconstruct points.csv --crs EPSG:32608 --method tin -o map --force -q",
        "--grid 5",
        "--grid 4",
        "map",
    ),
    "localize": _of(
        "localize recording -o localized --force -q",
        "",
        "--set localization.gps_white_sigma_m=2.0",
        "localized",
    ),
    "change": _of(
        "change dem.tif older.tif --outline outline.gpkg -o change --force",
        "--density 850",
        "--density 900",
        "change",
    ),
    "export": Command(
        ("export dem.tif out.asc --force", "export older.tif out.asc --force"), ("out.asc", "out.prj")
    ),
    "reproduce": _of(
        "reproduce glacier-tables -o studies --force -q", "--quick", "", "studies/glacier-tables"
    ),
    "run --fresh": _run("run m.toml --runs fresh -q --until plan --fresh", "fresh/small/latest", "1-plan"),
    "run --from": _run(
        "run m.toml --runs again -q --from score", "again/small/latest", "5-score", "6-report"
    ),
    "report": _run("report report/small/latest -q", "report/small/latest", "6-report"),
    "montecarlo": _of(
        "montecarlo --runs montecarlo -q --engine serial --fresh",
        "s.toml",
        "other.toml",
        "montecarlo/small/index.html",
        companions=tuple(f"montecarlo/small/{name}" for name in _WITH_PAGE),
    ),
}


def write_inputs(folder: Path) -> None:
    """Write an input for every command."""
    rng = np.random.default_rng(1)
    grid = Grid((0.0, 0.0, 150.0, 150.0), 5.0, UTM)
    dem = Dem.on(grid, 100.0 + np.cumsum(rng.normal(size=grid.shape), axis=0))
    dem.write(folder / "dem.tif")
    Dem.on(grid, dem.elevation - rng.random(grid.shape)).write(folder / "older.tif")
    SurveyArea.rectangle((0.0, 0.0, 150.0, 150.0), UTM).write(folder / "area.gpkg")
    SurveyArea.rectangle((40.0, 40.0, 100.0, 100.0), UTM).write(folder / "outline.gpkg")
    points = np.column_stack([grid.xy, dem.at(grid.xy)])[::7]
    SurfacePoints(points, sigma_m=0.1, crs=UTM).write(folder / "points.csv")
    (folder / "m.toml").write_text(MISSION)
    (folder / "s.toml").write_text(STUDY)
    (folder / "other.toml").write_text(f"seed = 3\n{STUDY}")


@contextmanager
def prepared(folder: Path) -> Iterator[ForkServer]:
    """Yield a server in a folder that holds an input for every command."""
    write_inputs(folder)
    with ForkServer(folder) as server:
        succeed(server, "run m.toml --runs report -q")
        recording = (folder / "report/small/latest/2-simulate/recording").resolve()
        (folder / "recording").symlink_to(recording)
        yield server


def succeed(server: ForkServer, command: str) -> None:
    """Run a command to its end; any other exit code than 0 is an error."""
    status = server.run(command)
    if status != 0:
        raise RuntimeError(f"firnline {command} ended with the status {status}; 0 was expected.")


class Trial:
    """A command in a folder, the outputs of its two variants, and how long its phases take.

    Both variants are run to their ends first.
    """

    def __init__(self, server: ForkServer, folder: Path, command: Command) -> None:
        self._server, self._folder, self.command = server, folder, command
        succeed(server, command.variants[1])
        self.complete = (self._timed(0), self._timed(1))
        self.outputs = tuple(digests for digests, _ in self.complete)
        self._now = 1

    def require_same_outputs(self) -> None:
        """Run both variants to their ends; another output than at first is an error."""
        for variant, output in enumerate(self.outputs):
            succeed(self._server, self.command.variants[variant])
            self._set(variant)
            if self.found() != output:
                raise RuntimeError(
                    f"after the kills, {self.command.variants[variant]} succeeded with another output than before."
                )

    def kill(self, phase: int, share: float) -> str | None:
        """Kill the variant that is not there at a share of the phase's length; return what is there afterwards.

        None when the command ended before.
        """
        before, new = self._now, 1 - self._now
        marks = self._marks()
        began = time.monotonic()
        process = self._server.start(self.command.variants[new])
        status = self._wait(phase, share * self.complete[new][1][phase], marks)
        if status is None:
            status = self._server.killed(process)
        if status not in (0, KILLED):
            raise RuntimeError(
                f"{self.command.variants[new]} ended with the status {status} after "
                f"{time.monotonic() - began:.2f} s; 0 was expected."
            )
        found = self.found()
        if status == 0 and found != self.outputs[new]:
            raise RuntimeError(f"{self.command.variants[new]} succeeded with another output than before.")
        return self.outcome(found, before, new) if status == KILLED else self._set(new)

    def found(self) -> dict[str, str]:
        """Return the digest of every output file, as the next command finds them; drafts are no output."""
        for name in self.command.outputs:
            if name.endswith(".asc"):
                existing_file(self._folder / name, "the raster")
        if self.command.run:
            run = RunFolder.find(self._folder / self.command.run)
            for stage in run.manifest["stages"]:
                run.verify(stage)
        paths = [self._folder / name for name in (*self.command.outputs, *self.command.companions)]
        files = [file for path in paths for file in (path, *path.rglob("*")) if file.is_file()]
        return {
            str(file.relative_to(self._folder)): hashlib.sha256(_without_clock(file)).hexdigest()
            for file in sorted(files)
        }

    def outcome(self, found: Digests, before: int, new: int) -> str:
        """Return what the files are: the output before, the new one, one without companions, or another."""
        for variant, name in ((before, OUTCOMES[0]), (new, OUTCOMES[1])):
            if found == self.outputs[variant]:
                self._now = variant
                return name
        for variant in (before, new):
            if self._lacks_companions(found, self.outputs[variant]):
                self._now = variant
                return OUTCOMES[2]
        return OUTCOMES[3]

    def _lacks_companions(self, found: Digests, expected: Digests) -> bool:
        """Return whether some companions are absent and all else is as expected."""
        absent = expected.keys() - found.keys()
        return found.items() <= expected.items() and all(
            name.startswith(self.command.companions) for name in absent
        )

    def _set(self, variant: int) -> None:
        self._now = variant

    def _marks(self) -> tuple[list[int], list[tuple[int, int]]]:
        """Return the times of change of the folders around the outputs, and those of the outputs."""
        paths = [self._folder / name for name in (*self.command.outputs, *self.command.companions)]
        parents = [path.parent.stat().st_mtime_ns for path in paths if path.parent.exists()]
        return parents, [mark for path in paths for mark in _mark(path)]

    def _wait(self, phase: int, seconds: float, marks: tuple[object, object]) -> int | None:
        """Wait for the phase and so many seconds more; return the exit status when the command ends before."""
        while phase and self._marks()[phase - 1] == marks[phase - 1]:
            status = self._server.ended(within_s=_POLL_S)
            if status is not None:
                return status
        return self._server.ended(within_s=seconds)

    def _timed(self, variant: int) -> tuple[dict[str, str], tuple[float, ...]]:
        """Run a variant to its end; return its output and the seconds from the begin of each phase to the end."""
        marks, begins = self._marks(), [time.monotonic()] * 3
        self._server.start(self.command.variants[variant])
        while (status := self._server.ended(within_s=_POLL_S)) is None:
            for phase, (now, then) in enumerate(zip(self._marks(), marks, strict=True), start=1):
                if now == then:
                    begins[phase] = time.monotonic()
        if status != 0:
            raise RuntimeError(f"firnline {self.command.variants[variant]} ended with the status {status}.")
        ended = time.monotonic()
        return self.found(), tuple(ended - began for began in begins)


def _without_clock(file: Path) -> bytes:
    """Return the content of a file; of a record without the time that its making took, and its date."""
    content = file.read_bytes()
    if file.name == "made.json":
        return re.sub(rb'"(cpu_s|wall_s|date|record_sha256)": [^\n]*', b"", content)
    return content


def _mark(path: Path) -> list[tuple[int, int]]:
    """Return number and time of change of a file, or nothing when it is absent at this moment."""
    try:
        stat = path.stat()
    except FileNotFoundError:
        return []
    return [(stat.st_ino, stat.st_mtime_ns)]


def kills(trial: Trial, name: str, n_kills: int) -> Counter[str]:
    """Kill a command so many times; return how often each outcome was found, and how often it ended before the kill."""
    moments = random.Random(name)
    counts: Counter[str] = Counter()
    n = 0
    while n < n_kills:
        outcome = trial.kill(n % len(PHASES), 0.8 * moments.random())
        counts[outcome or "ended before the kill"] += 1
        n += outcome is not None
        if outcome == OUTCOMES[3]:
            return counts
    trial.require_same_outputs()
    return counts


def store(run: Run, name: str, counts: Counter[str], n_kills: int) -> dict[str, int]:
    """Put the counts of a command into the stored table and return them; other commands stay as they are."""
    stored = read_table(RESULT) or {"kills": {}}
    row = {outcome: counts[outcome] for outcome in (*OUTCOMES, "ended before the kill")}
    rows = {**stored["kills"], name: row}
    content = {
        "command": f"python -m benchmarks.replacing_kills --kills {n_kills}",
        "kills": {command: rows[command] for command in COMMANDS if command in rows},
    }
    run.write(content)
    return row


def main() -> None:
    """Print and store the counts of every command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50, help="kills of each command")
    parser.add_argument("--command", choices=COMMANDS, action="append", help="only this command")
    options = parser.parse_args()
    run = Run.begin(main, RESULT)
    with tempfile.TemporaryDirectory() as place, prepared(Path(place)) as server:
        for name in options.command or COMMANDS:
            began = time.monotonic()
            trial = Trial(server, Path(place), COMMANDS[name])
            row = store(run, name, kills(trial, name, options.kills), options.kills)
            print(f"{name:<12} {time.monotonic() - began:6.1f} s  {row}", flush=True)


if __name__ == "__main__":
    main()
