"""Pose files: TUM and KITTI text."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.checksum import checksum, refuse_altered
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing

TUM_COLUMNS = ("time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
KITTI_COLUMNS = tuple(
    f"{'xyz'[row] if column == 3 else 'r'}{row}{column}" for row in range(3) for column in range(4)
)
# TUM readers skip lines like these; they show that a file was cut off at the end of a line, or altered.
_COUNT, _CRC = "# poses: ", "# crc32: "
_SHORTEST = 1e-6


def write_tum(path: str | Path, rows: FloatArray) -> None:
    """Write poses (N, 8) as TUM text; numbers read back exactly as they were.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    rows : (N, 8) ndarray
        Time [s], position [m], quaternion x y z w.
    """
    lines = _lines(rows)
    _write_lines(
        path, [f"# {' '.join(TUM_COLUMNS)}", f"{_COUNT}{len(rows)}", f"{_CRC}{checksum(lines)}", *lines]
    )


def read_tum(path: str | Path) -> FloatArray:
    """Read TUM text into (N, 8): time, position, quaternion x y z w.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    (N, 8) ndarray
        Time [s], position [m], quaternion x y z w.

    Raises
    ------
    InputError
        Missing, empty, a line without eight numbers, or a quaternion of length 0; the message
        names the line.
    """
    rows = _read_rows(path, TUM_COLUMNS, "TUM")
    no_turn = np.flatnonzero(np.linalg.norm(rows[:, 4:8], axis=1) < _SHORTEST)
    if len(no_turn):
        raise InputError(
            f"pose {no_turn[0] + 1} of {path} has a quaternion of length 0, which is no orientation; check the columns."
        )
    return rows


def write_kitti(path: str | Path, poses: FloatArray) -> None:
    """Write poses (N, 3, 4), rotation and position, as KITTI text, which has no times.

    Numbers read back exactly as they were.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    poses : (N, 3, 4) ndarray
        Rotations, and positions [m] in the last column.
    """
    _write_lines(path, _lines(poses.reshape(-1, 12)))


def read_kitti(path: str | Path) -> FloatArray:
    """Read KITTI text into (N, 3, 4): rotation and position.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    (N, 3, 4) ndarray
        Rotations, and positions [m] in the last column.

    Raises
    ------
    InputError
        Missing, empty, a line without twelve numbers, or a rotation that is none.
    """
    poses = _read_rows(path, KITTI_COLUMNS, "KITTI").reshape(-1, 3, 4)
    turn = poses[:, :, :3]
    off = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero(~(off < 1e-3) | (np.linalg.det(turn) < 0.0))
    if len(bad):
        raise InputError(
            f"the trajectory {path}, pose {bad[0] + 1}: its nine numbers are no rotation; correct it."
        )
    return poses


def _lines(rows: FloatArray) -> list[str]:
    return [" ".join(map(repr, row)) for row in rows.tolist()]


def _write_lines(path: str | Path, lines: Sequence[str]) -> None:
    with replacing(path) as draft, draft.open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for line in lines)


def _read_rows(path: str | Path, columns: Sequence[str], kind: str) -> FloatArray:
    file = existing_file(path, "the trajectory")
    try:
        content = file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            f"the trajectory {file} is no text ({error.reason}); a {kind} file was expected."
        ) from error
    if not content.endswith("\n"):
        raise InputError(
            f"the trajectory {file} ends in the middle of a line; it may be cut off, make it again or end it with a line break."
        )
    numbered = [
        (number, line)
        for number, line in enumerate(content.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    rows = [_row(line, columns, f"the trajectory {file}, line {number}") for number, line in numbered]
    _refuse_incomplete(file, content, [line for _, line in numbered])
    if not rows:
        raise InputError(
            f"the trajectory {file} holds no poses; {len(columns)} numbers a line were expected."
        )
    array: FloatArray = np.array(rows)
    return array


def _refuse_incomplete(file: Path, content: str, lines: Sequence[str]) -> None:
    """Hold the poses against the count and the checksum that the file's comments state, where they do."""
    stated = {
        mark: line.removeprefix(mark)
        for line in content.splitlines()
        for mark in (_COUNT, _CRC)
        if line.startswith(mark)
    }
    if stated.get(_COUNT, str(len(lines))) != str(len(lines)):
        raise InputError(
            f"the trajectory {file} holds {len(lines)} of {stated[_COUNT][:16]} poses; it was cut off or joined, make it again."
        )
    if _CRC in stated:
        refuse_altered(file, stated[_CRC], lines, f"its line {_CRC.strip()!r}")


def _row(line: str, columns: Sequence[str], where: str) -> list[float]:
    try:
        numbers = [float(word) for word in line.replace(",", " ").split()]
    except ValueError as error:
        raise InputError(f"{where}: {error}; {' '.join(columns)} were expected.") from error
    if len(numbers) != len(columns):
        raise InputError(f"{where}: {len(numbers)} numbers; {' '.join(columns)} were expected.")
    return numbers
