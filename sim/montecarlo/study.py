"""Monte Carlo: a study from its file to a table, stored block by block so that any kill leaves it resumable.

study.toml ──▶ blocks/*.parquet, in any order, by any engine ──▶ trials.parquet, trials.csv
                                   ──▶ summary.csv, minimum_swaths.csv ──▶ figures, page
"""

import fcntl
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import IO, Any

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from sim.executors import Engine, done
from sim.montecarlo.config import StudyConfig
from sim.montecarlo.report import write_study_report
from sim.montecarlo.summary import minimum_swaths, summary, write_rows
from sim.montecarlo.trials import Trial, TrialBlock, as_columns, blocks_of, survey_block
from survey.core.documents import read_json, write_json
from survey.core.errors import ConfigError, InputError
from survey.core.files import existing_file, replacing
from survey.core.manifest import file_sha256

TrialProgress = Callable[[int, int], None]
"""Called with the number of trials done and of all trials."""

_TYPES = {str: pa.string(), int: pa.int32(), float: pa.float64()}
SCHEMA = pa.schema([(field.name, _TYPES[field.type]) for field in fields(Trial)])  # type: ignore[index]


def run_study(
    study: StudyConfig,
    folder: Path,
    *,
    engine: Engine = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    watch: TrialProgress = lambda *_: None,
) -> Path:
    """Do every trial that is not done yet, then the table, the summary and the page.

    Parameters
    ----------
    study : StudyConfig
        What to do.
    folder : Path
        Where it is kept. A folder that holds a part of the same study is continued.
    engine, workers, scheduler
        See `sim.executors.done`; the tables are the same bytes whatever they are.
    fresh : bool
        Do every trial anew.
    watch : callable
        Told how far the study is.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ConfigError
        The folder holds another study; the message names what differs.
    InputError
        The disk is full, a stored block is damaged, no scheduler answers, or another run is at it.
    """
    with _opened(study, folder, fresh=fresh):
        blocks = blocks_of(study)
        left = [block for block in blocks if not _file(folder, block).exists()]
        n_done = sum(block.n for block in blocks) - sum(block.n for block in left)
        total = sum(block.n for block in blocks)
        watch(n_done, total)
        pieces = done(partial(survey_block, study), left, engine=engine, workers=workers, scheduler=scheduler)
        for block, trials in pieces:
            _store(_file(folder, block), trials)
            n_done += block.n
            watch(n_done, total)
        write_table(folder, blocks)
        rows = summary(folder / "trials.parquet", study)
        write_rows(folder / "summary.csv", rows)
        write_rows(folder / "minimum_swaths.csv", minimum_swaths(rows, study))
        return write_study_report(folder, study, rows)


def write_table(folder: Path, blocks: Sequence[TrialBlock]) -> None:
    """Join the blocks, in the order of the study, into one Parquet and one CSV table; one block is in memory at a time."""
    with replacing(folder / "trials.parquet") as draft, pq.ParquetWriter(draft, SCHEMA) as parquet:
        for table in _tables(folder, blocks):
            parquet.write_table(table)
    with replacing(folder / "trials.csv") as draft, pa_csv.CSVWriter(draft, SCHEMA) as text:
        for table in _tables(folder, blocks):
            text.write_table(table)


def _tables(folder: Path, blocks: Sequence[TrialBlock]) -> Iterator[pa.Table]:
    for block in blocks:
        file = _file(folder, block)
        try:
            yield pq.read_table(file, schema=SCHEMA)
        except (OSError, pa.ArrowException) as error:
            raise InputError(
                f"the block {file} is damaged ({str(error).splitlines()[0]}); delete it and run the study again."
            ) from error


def _store(file: Path, trials: Sequence[Trial]) -> None:
    with replacing(file) as draft:
        pq.write_table(pa.table(as_columns(trials), schema=SCHEMA), draft)


def _file(folder: Path, block: TrialBlock) -> Path:
    return folder / "blocks" / f"{block.name}.parquet"


@contextmanager
def _opened(study: StudyConfig, folder: Path, *, fresh: bool) -> Iterator[None]:
    """Hold the study's folder for one run; make it, or check that it holds this very study."""
    inputs = {
        name: file_sha256(existing_file(file, f"the prior of {name},"))
        for name, file in study.input_files.items()
    }
    begun = {"study": study.model_dump(mode="json"), "inputs_sha256": inputs}
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
        elif (folder / "study.json").exists():
            _require_same(read_json(folder / "study.json", "the study that was begun"), begun, folder)
        write_json(folder / "study.json", begun)
        for leftover in [*folder.glob(".*-*"), *(folder / "blocks").glob(".*-*")]:
            shutil.rmtree(leftover, ignore_errors=True)
        yield


def _hold(lock: IO[str], folder: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise InputError(f"another run is working on {folder}; wait for it or stop it.") from error


def _require_same(before: dict[str, Any], now: dict[str, Any], folder: Path) -> None:
    # Compared as they are written, where tuples are lists.
    for where, old, new in _differences(before, json.loads(json.dumps(now)), ""):
        raise ConfigError(
            f"the study in {folder} was begun with {where} = {old}, and now it is {new}; "
            "take it back, give the study another name, or add --fresh to begin anew."
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
