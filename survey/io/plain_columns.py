"""Columns of plain tables of text, split and converted by Arrow at once.

A table is plain where every reader splits and reads it alike: cells in ASCII without quotation marks, equally many in
every line, and numbers with one decimal mark. For all others `plain_columns` returns None, and the readers of
`survey.io.tables` and `survey.io.text_tables` look at every cell.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

LEAST_BYTES = 500_000
"""Smallest table that is worth the import of Arrow."""
Kind = Literal["number", "text", "unused"]
_OF_NUMBERS = b"0123456789+-.,;eE \t\r\n"
# Quotation marks, what Python takes for the end of a line and Arrow does not, and nan(...), which only Arrow reads.
_NOT_PLAIN = (b'"', b"\0", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e", b"(")


def plain_columns(
    body: bytes, separator: str, kinds: Sequence[Kind], decimal: str = "."
) -> Mapping[int, Any] | None:
    r"""Return the columns of the rows of a table by their index, numbers (N,) or Arrow's texts; None where it is not plain.

    >>> {k: column.tolist() for k, column in plain_columns(b"1,2.5\n3,4\n", ",", ("unused", "number")).items()}
    {1: [2.5, 4.0]}
    """
    rest = body.translate(None, _OF_NUMBERS)
    if len(kinds) < 2 or not rest.isascii() or any(mark in rest for mark in _NOT_PLAIN):
        return None
    if separator == " " and b"\t" in body:
        return None
    body = body.rstrip(b"\r\n")
    found = None
    if separator != " " or {*kinds} == {"number"}:
        found = _read(body, separator, kinds, decimal)
    return (
        _read(_with_single_blanks(body), " ", kinds, decimal) if found is None and separator == " " else found
    )


def _read(body: bytes, separator: str, kinds: Sequence[Kind], decimal: str) -> dict[int, Any] | None:
    """Return the columns of rows of one separator between cells; None where rows differ or a number is none."""
    import pyarrow as pa
    from pyarrow import csv

    types = {"number": pa.float64(), "text": pa.string()}
    used = {str(k): types[kind] for k, kind in enumerate(kinds) if kind != "unused"}
    try:
        table = csv.read_csv(
            pa.BufferReader(body),
            csv.ReadOptions(use_threads=False, column_names=[str(k) for k in range(len(kinds))]),
            csv.ParseOptions(delimiter=separator, quote_char=False, ignore_empty_lines=False),
            csv.ConvertOptions(
                check_utf8=False,
                column_types=used,
                include_columns=list(used),
                null_values=[],
                decimal_point=decimal,
            ),
        )
    except pa.ArrowInvalid:
        return None
    return {
        int(name): table[name].to_numpy() if used[name] == types["number"] else table[name] for name in used
    }


def may_be_numbers(texts: Any) -> list[str]:
    """Return the different cells of a column of Arrow's texts that hold nothing but digits and marks of numbers."""
    from pyarrow import compute

    different = compute.unique(texts)
    found: list[str] = different.filter(
        compute.match_substring_regex(different, r"^[-+0-9.,'eE\s]+$")
    ).to_pylist()
    return found


def _with_single_blanks(body: bytes) -> bytes:
    """Return lines with one blank between cells, and none at their ends."""
    characters = np.frombuffer(body, dtype=np.uint8)
    is_blank = characters == ord(" ")
    ends = is_blank | (characters == ord("\n")) | (characters == ord("\r"))
    is_kept = ~(is_blank & np.append(ends[1:], True))
    single: bytes = characters[is_kept].tobytes()
    return single.replace(b"\n ", b"\n").lstrip(b" ")
