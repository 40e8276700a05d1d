"""Which studies stand whole in a folder of results: each has a record of its files, written last."""

from importlib.metadata import version
from pathlib import Path

from survey.core.documents import read_json, write_json
from survey.core.errors import InputError
from survey.core.manifest import file_sha256

_RECORD = "made.json"


def record(folder: Path, *, quick: bool) -> None:
    """Tell that a study is whole: how it was made, and the checksums of its files."""
    files = {path.name: file_sha256(path) for path in sorted(folder.iterdir()) if _is_product(path)}
    made = {"firnline": version("firnline"), "quick": quick, "files_sha256": files}
    write_json(folder / _RECORD, made)


def stands(folder: Path, *, quick: bool) -> bool:
    """Tell whether a study is there, its files unchanged; one that was made in full also does for a quick one."""
    if not (folder / _RECORD).exists():
        return False
    try:
        made = read_json(folder / _RECORD, "the record of a study")
        kept = {folder / name: digest for name, digest in made["files_sha256"].items()}
        is_enough = quick or not made["quick"]
    except (InputError, KeyError, AttributeError):
        return False
    return is_enough and all(path.is_file() and file_sha256(path) == digest for path, digest in kept.items())


def forget(folder: Path) -> None:
    """Let a study stand no more; its files stay until they are made anew."""
    (folder / _RECORD).unlink(missing_ok=True)


def _is_product(path: Path) -> bool:
    return path.is_file() and path.name != _RECORD
