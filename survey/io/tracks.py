"""Trajectory files: TUM text (time, position, quaternion) and a CSV table with covariances."""

from pathlib import Path
from typing import Any

import numpy as np

from survey.arrays import FloatArray
from survey.errors import InputError
from survey.io.files import existing_file, replacing

TUM_COLUMNS = ("time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


def write_tum(path: str | Path, rows: FloatArray) -> None:
    """Write poses (N, 8) as TUM text; numbers read back exactly as they were."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8") as file:
        file.write("# " + " ".join(TUM_COLUMNS) + "\n")
        file.writelines(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def read_tum(path: str | Path) -> FloatArray:
    """Read TUM text into (N, 8): time, position, quaternion x y z w.

    Raises
    ------
    InputError
        Missing, empty, or a line without eight numbers; the message names the line.
    """
    file = existing_file(path, "the trajectory")
    rows: list[list[float]] = []
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(
            f"the trajectory {file} is no text ({error.reason}); a TUM file was expected."
        ) from error
    for number, line in enumerate(lines, start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            rows.append(_eight_numbers(line, f"the trajectory {file}, line {number}"))
    if not rows:
        raise InputError(f"the trajectory {file} holds no poses; eight numbers a line were expected.")
    array: FloatArray = np.array(rows)
    return array


def _eight_numbers(line: str, where: str) -> list[Any]:
    try:
        numbers = [float(word) for word in line.replace(",", " ").split()]
    except ValueError as error:
        raise InputError(f"{where}: {error}; {' '.join(TUM_COLUMNS)} were expected.") from error
    if len(numbers) != len(TUM_COLUMNS):
        raise InputError(f"{where}: {len(numbers)} numbers; {' '.join(TUM_COLUMNS)} were expected.")
    return numbers
