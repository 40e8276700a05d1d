"""Records of finished studies: which studies in a folder of results are complete and unchanged."""

import shutil
from importlib.metadata import version
from pathlib import Path

from survey.core.documents import read_json
from survey.core.errors import InputError
from survey.core.files.exchange import exchange
from survey.core.files.replacing import refuse_foreign
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


def replace_study(draft: Path, folder: Path) -> None:
    """Put a finished study in its place, and delete the old one.

    Parameters
    ----------
    draft : pathlib.Path
        The new study with its record, beside `folder`.
    folder : pathlib.Path
        The study's place.

    Raises
    ------
    InputError
        The old folder holds files that neither its record nor the new one lists.
    """
    own = {RECORD, *read_record(draft)["files_sha256"]}
    if (folder / RECORD).exists():
        own |= set(read_json(folder / RECORD, "the record of the folder").get("files_sha256", {}))
    refuse_foreign(folder, own)
    exchange(draft, folder)
    shutil.rmtree(draft, ignore_errors=True)
