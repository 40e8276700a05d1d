"""Records of finished studies: which studies in a folder of results are complete and unchanged."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

from survey.core.documents import read_json
from survey.core.errors import InputError
from survey.core.files.exchange import exchange
from survey.core.files.replacing import lock_folder, refuse_foreign
from survey.core.files.writing import write_refusal
from survey.core.runs.manifest import RECORD, read_record, write_record


def record(folder: Path, *, quick: bool) -> None:
    """Record that a study is complete: the version and depth that made it, and the checksums of its files.

    Parameters
    ----------
    folder : pathlib.Path
        The study's folder; files in folders below it (blocks of trials) are not listed.
    quick : bool
        Whether it was made smaller and rougher.
    """
    files = [path for path in folder.iterdir() if path.is_file() and path.name != RECORD]
    write_record(folder, files, {"firnline": version("firnline"), "quick": quick})


def is_complete(folder: Path, *, quick: bool) -> bool:
    """Return whether a study is complete, unchanged, and made by this version of firnline.

    Parameters
    ----------
    folder : pathlib.Path
        The study's folder.
    quick : bool
        Whether a quick study will do; a full one always does.

    Returns
    -------
    bool
        False also when the record itself is damaged.
    """
    try:
        made = read_record(folder)
    except InputError:
        return False
    return made.get("firnline") == version("firnline") and (quick or made.get("quick") is False)


@contextmanager
def replacing_study(folder: Path, *, quick: bool) -> Iterator[Path]:
    """Yield the draft of a study; record it and put it in its place when the body ends without an error.

    The draft stands beside `folder` as ``<name>.unfinished`` or ``<name>.unfinished-quick`` and stays
    after an error or a kill. The next call continues in it: the folders of blocks in it stay, its files are
    made again. A finished study gets the name ``.<name>.draft`` before it is exchanged with the old one,
    so that the old one is never taken for an unfinished study.

    Parameters
    ----------
    folder : pathlib.Path
        The study's place; its parents are created.
    quick : bool
        Whether it is made smaller and rougher.

    Yields
    ------
    pathlib.Path
        The draft, with no files in it.

    Raises
    ------
    InputError
        The old folder holds files that its record does not list, the draft cannot be created, or
        another process makes the study.
    """
    draft = folder.with_name(f"{folder.name}.unfinished{'-quick' if quick else ''}")
    refuse_foreign(folder, _own_files(folder))
    with _locked(draft, folder):
        _remove_files(draft)
        yield draft
        record(draft, quick=quick)
        refuse_foreign(folder, _own_files(folder))
        finished = folder.with_name(f".{folder.name}.draft")
        shutil.rmtree(finished, ignore_errors=True)
        draft.replace(finished)
        exchange(finished, folder)
        shutil.rmtree(finished, ignore_errors=True)


@contextmanager
def _locked(draft: Path, folder: Path) -> Iterator[None]:
    """Create the draft of a study where it is missing, and keep other processes out of it."""
    try:
        draft.mkdir(parents=True, exist_ok=True)
        lock = lock_folder(draft, folder)
    except OSError as error:
        raise write_refusal(folder, error) from error
    try:
        yield
    finally:
        os.close(lock)


def _remove_files(draft: Path) -> None:
    """Remove the files of a stopped study, and the drafts of files that a killed process left."""
    for path in draft.iterdir():
        if not path.is_dir():
            path.unlink()
        elif path.name.startswith("."):
            shutil.rmtree(path)


def _own_files(folder: Path) -> set[str]:
    """Return the names of the files that the record of a study lists, and of the record."""
    if not (folder / RECORD).exists():
        return set()
    listed = read_json(folder / RECORD, "the record of the folder").get("files_sha256", {})
    return {RECORD, *listed}
