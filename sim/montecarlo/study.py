"""Monte Carlo studies: trials run in blocks that are stored one by one, so that a killed study can be resumed.

study.toml ──▶ blocks/*.parquet, in any order, by any engine ──▶ trials.parquet, trials.csv
                                   ──▶ summary.csv, minimum_swaths.csv ──▶ figures, page

`require_study` checks the sizes before the first trial.
"""

import fcntl
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any

from sim.mission.capacity import require_terrain_cells
from sim.mission.runs import current_versions, input_checksums, refuse_other_versions
from sim.montecarlo.config import RandomKind, StudyConfig, TrialBlock, blocks_of, trials_together
from sim.montecarlo.results import (
    block_file,
    minimum_swaths,
    summarize_trials,
    write_block,
    write_rows,
    write_study_report,
    write_tables,
)
from sim.montecarlo.trials import survey_block
from survey import CapacityError, ConfigError, InputError
from survey.core import PictureKind
from survey.core.documents import RECORD, is_intact, read_json, with_checksum, write_json, write_record
from survey.core.executors import Engine, run_all
from survey.core.replacement import refuse_unwritable, replacing_files
from survey.reconstruction.capacity import smallest_step_m
from survey.reporting.rendering import PictureForm

_BEGUN, _BEGUN_SHA256 = "study.json", "study_sha256"
TrialProgress = Callable[[int, int], None]
"""Called with the number of trials done and of all trials."""
RESULTS = (
    "index.html", "trials.parquet", "trials.csv", "summary.csv", "minimum_swaths.csv", "figures", RECORD,
)  # fmt: skip
"""What a finished study consists of, beside ``study.json`` and its blocks; `RECORD` has the checksums."""


def run_study(
    study: StudyConfig,
    folder: Path,
    *,
    engine: Engine = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    pictures: PictureKind = "png",
    watch: TrialProgress = lambda *_: None,
) -> Path:
    """Run every trial that is not done yet, then write the tables, the summary and the page."""
    require_study(study)
    with _opened(study, folder, fresh=fresh):
        blocks = blocks_of(study)
        left = [block for block in blocks if not block_file(folder, block).exists()]
        if 0 < len(left) < len(blocks):
            _refuse_other_versions(folder)
        total = sum(block.n for block in blocks)
        n_done = total - sum(block.n for block in left)
        watch(n_done, total)
        pieces = run_all(
            partial(survey_block, study), left, engine=engine, workers=workers, scheduler=scheduler
        )
        for block, trials in pieces:
            write_block(folder, block, trials)
            n_done += block.n
            watch(n_done, total)
        _write_results(study, folder, blocks, pictures)
    return folder / "index.html"


def _refuse_other_versions(folder: Path) -> None:
    before = _read_begun(folder)["versions"]
    refuse_other_versions(before, f"the study in {folder}", "do all trials again with --fresh")


def _write_results(
    study: StudyConfig, folder: Path, blocks: Sequence[TrialBlock], pictures: PictureKind
) -> None:
    """Write tables, page and their record to a draft, and put all of them in place together."""
    with replacing_files(*(folder / name for name in RESULTS)) as (page, *_):
        draft = page.parent
        write_tables(draft, folder, blocks)
        rows = summarize_trials(draft / "trials.parquet", study)
        write_rows(draft / "summary.csv", rows)
        write_rows(draft / "minimum_swaths.csv", minimum_swaths(rows, study))
        write_study_report(draft, study, rows, PictureForm(pictures))
        write_record(draft, [file for file in draft.rglob("*") if file.is_file()], {})


@contextmanager
def _opened(study: StudyConfig, folder: Path, *, fresh: bool) -> Iterator[None]:
    """Hold the study's folder for one run; make it, or check that it holds this very study."""
    begun = {"study": study.model_dump(mode="json"), "inputs_sha256": input_checksums(study.input_files)}
    refuse_unwritable(folder, is_folder=True)
    try:
        (folder / "blocks").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"the study's folder {folder} cannot be made ({error.strerror}); choose another place with --runs."
        ) from error
    with (folder / "lock").open("w") as lock:
        _hold(lock, folder)
        if fresh:
            shutil.rmtree(folder / "blocks")
            (folder / "blocks").mkdir()
        versions = current_versions()
        if not fresh and (folder / _BEGUN).exists():
            before = _read_begun(folder)
            _require_same(before, begun, folder)
            if any((folder / "blocks").iterdir()):
                versions = before["versions"]
        write_json(folder / _BEGUN, with_checksum({**begun, "versions": versions}, _BEGUN_SHA256))
        for leftover in [*folder.glob(".*-*"), *(folder / "blocks").glob(".*-*")]:
            shutil.rmtree(leftover, ignore_errors=True)
        yield


def _read_begun(folder: Path) -> dict[str, Any]:
    """Read the study that a folder was begun with, and check it."""
    begun = read_json(folder / _BEGUN, "the study that was begun")
    if not is_intact(begun, _BEGUN_SHA256):
        raise InputError(
            f"{folder / _BEGUN} was changed or comes from another version; do all trials again with --fresh."
        )
    return begun


def _hold(lock: IO[str], folder: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise InputError(f"another run is working on {folder}; wait for it or stop it.") from error


def _require_same(before: dict[str, Any], now: dict[str, Any], folder: Path) -> None:
    # Compared as they are written, where tuples are lists.
    now = json.loads(json.dumps(now))
    for where, old, new in _differences({key: before[key] for key in now}, now, ""):
        raise ConfigError(
            f"the study in {folder} was begun with {where} = {old}, and now it is {new}; "
            "take it back, give the study another name, or add --fresh to do all trials again."
        )


def _differences(old: Any, new: Any, where: str) -> Iterator[tuple[str, str, str]]:
    """Yield where two documents differ, and what stands there."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            inner = f"{where}.{key}" if where else key
            yield from _differences(old.get(key), new.get(key), inner.removeprefix("study."))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _differences(one, other, f"{where}.{index}")
    elif old != new:
        yield where, json.dumps(old), json.dumps(new)


MOST_ROWS = 100_000_000
"""Rows of the table of trials; about 100 bytes each."""
MOST_CELLS_TOGETHER = 200_000_000
"""Cells of all terrains of a block, 8 bytes each."""
MOST_NODES = 1_000_000
"""Nodes at which a map is judged."""


def require_study(study: StudyConfig) -> None:
    """Refuse a study whose table, terrains or maps would not fit."""
    per_trial = len(study.terrains) * len(study.designs) * len(study.maps)
    if study.trials * per_trial > MOST_ROWS:
        raise CapacityError(
            f"{study.trials} trials give {study.trials * per_trial:.3g} rows, and {MOST_ROWS} can be stored; "
            f"set trials to at most {MOST_ROWS // per_trial}."
        )
    together = min(trials_together(study), study.trials)
    for kind in study.terrains:
        if isinstance(kind, RandomKind):
            require_terrain_cells(kind.size_m, kind.size_m, kind.step_m, MOST_CELLS_TOGETHER // together)
            _require_nodes(kind.size_m, study.map_step_m)


def _require_nodes(size_m: float, step_m: float) -> None:
    """Refuse more nodes than maps can be judged at."""
    n_nodes = (size_m / step_m) ** 2
    if n_nodes > MOST_NODES:
        smallest = smallest_step_m(size_m, size_m, MOST_NODES)
        raise CapacityError(
            f"map_step_m = {step_m:g} gives {n_nodes:.3g} nodes on {size_m:g} m, and maps can be judged at {MOST_NODES}; "
            f"set it to {smallest:g} or more."
        )
