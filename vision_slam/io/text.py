"""Text of recordings: UTF-8 with or without a byte order mark."""

from pathlib import Path

from survey.core.errors import InputError
from survey.core.files.reading import existing_file


def read_text(path: str | Path, what: str) -> str:
    """Return the text of a file without its byte order mark.

    Raises
    ------
    InputError
        Missing, empty, or no UTF-8.
    """
    file = existing_file(path, what)
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{what} {file} is no UTF-8 text (byte {error.start + 1}); save it as UTF-8 or get it again."
        ) from error
