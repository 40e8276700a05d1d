"""Parquet tables of trials, one for each block and one of the study, with checksums of their values."""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from functools import reduce
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from sim.montecarlo.blocks import Trial, TrialBlock, as_columns
from survey.core.checksum import checksum
from survey.core.errors import InputError
from survey.core.files.library_messages import first_line
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing
from survey.core.text import csv_cell

_CRC = b"firnline_crc32"
_TYPES = {str: pa.string(), int: pa.int32(), float: pa.float64()}
SCHEMA = pa.schema([(field.name, _TYPES[field.type]) for field in fields(Trial)])  # type: ignore[index]


def block_file(folder: Path, block: TrialBlock) -> Path:
    """Return the file of a block in a study's folder."""
    return folder / "blocks" / f"{block.name}.parquet"


def write_block(folder: Path, block: TrialBlock, trials: Sequence[Trial]) -> None:
    """Write the trials of a block with the checksum of their values."""
    with replacing(block_file(folder, block)) as draft:
        _write(draft, [pa.table(as_columns(trials), schema=SCHEMA)])


def write_tables(draft: Path, folder: Path, blocks: Sequence[TrialBlock]) -> None:
    """Join the blocks of a study's folder, in its order, into ``trials.parquet`` and ``trials.csv`` of a draft folder.

    One block is in memory at a time.

    Raises
    ------
    InputError
        A block is damaged or holds other trials, or the disk is full.
    """
    _write(draft / "trials.parquet", _tables(folder, blocks))
    with pa_csv.CSVWriter(draft / "trials.csv", SCHEMA) as text:
        for table in _tables(folder, blocks):
            text.write_table(_with_escaped_names(table))


def read_trials(path: Path) -> pa.Table:
    """Read a table of trials and check the checksum of its values.

    Parameters
    ----------
    path : pathlib.Path
        A block or ``trials.parquet``.

    Returns
    -------
    pyarrow.Table
        One row for each trial, with the columns of `Trial`.

    Raises
    ------
    InputError
        The file is missing, damaged, or carries no checksum.
    """
    file = existing_file(path, "the table of trials")
    try:
        with pq.ParquetFile(file) as stored:
            stated = (stored.metadata.metadata or {})[_CRC].decode("ascii")
            groups = [stored.read_row_group(n).cast(SCHEMA) for n in range(stored.num_row_groups)]
        crc = reduce(_crc, groups, "0")
    except Exception as error:  # a damaged file fails in thrift, the codec, UTF-8, the cast, …
        raise _damaged(file, first_line(error)) from error
    if crc != stated:
        raise _damaged(file, f"its values have the checksum {crc}, and it states {stated[:16]!r}")
    return pa.concat_tables(groups) if groups else SCHEMA.empty_table()


def _write(path: Path, tables: Sequence[pa.Table] | Iterator[pa.Table]) -> None:
    """Write tables as row groups of one file, and the checksum of all into its footer."""
    crc = "0"
    with pq.ParquetWriter(path, SCHEMA) as parquet:
        for table in tables:
            parquet.write_table(table, row_group_size=max(len(table), 1))
            crc = _crc(crc, table)
        parquet.add_key_value_metadata({_CRC.decode("ascii"): crc})


def _tables(folder: Path, blocks: Sequence[TrialBlock]) -> Iterator[pa.Table]:
    for block in blocks:
        yield read_trials(block_file(folder, block))


def _with_escaped_names(table: pa.Table) -> pa.Table:
    """Escape the columns of names for a CSV table."""
    for place, field in enumerate(SCHEMA):
        if pa.types.is_string(field.type):
            names = [csv_cell(name) for name in table.column(place).to_pylist()]
            table = table.set_column(place, field, pa.array(names, field.type))
    return table


def _crc(before: str, table: pa.Table) -> str:
    """Return the checksum of a table's values that follow those with the checksum `before`."""
    parts: list[object] = [before]
    for field, column in zip(SCHEMA, table.columns, strict=True):
        is_text = pa.types.is_string(field.type)
        parts += [field.name, "\x1f".join(column.to_pylist()) if is_text else np.asarray(column)]
    return checksum(parts)


def _damaged(file: Path, reason: str) -> InputError:
    return InputError(f"the table {file} is damaged ({reason}); delete it and run the study again.")
