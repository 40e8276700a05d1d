"""Reproduction of the papers' figures and tables: one study per figure, found by its name.

`STUDIES` maps names to functions. The record of a finished study holds the version and depth that made it and the
checksums of its files; a study that is complete and unchanged is not run again.
"""

import difflib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, cast

from survey.core import InputError, Progress, read_json
from survey.core.documents import RECORD, read_record, write_record
from survey.core.files import write_refusal
from survey.core.replacement import exchange, lock_folder, refuse_foreign


class Study(Protocol):
    """Produces one figure or table in a folder."""

    def __call__(self, folder: Path, *, quick: bool, progress: Progress) -> None:
        """Write pictures and tables into `folder`; `quick` makes them smaller and rougher."""


STUDIES: dict[str, str] = {
    "glacier-fig4": "papers.glacier.images:glacier_fig4",
    "glacier-fig5": "papers.glacier.terrain:glacier_fig5",
    "glacier-fig6": "papers.glacier.terrain:glacier_fig6",
    "glacier-fig7": "papers.glacier.terrain:glacier_fig7",
    "glacier-fig8": "papers.glacier.terrain:glacier_fig8",
    "glacier-tables": "papers.glacier.terrain:glacier_tables",
    "glacier-fig9": "papers.glacier.monte_carlo:glacier_fig9",
    "glacier-fig10": "papers.glacier.monte_carlo:glacier_fig10",
    "glacier-fig11": "papers.glacier.monte_carlo:glacier_fig11",
    "glacier-fig12": "papers.glacier.surveys:glacier_fig12",
    "glacier-fig13": "papers.glacier.surveys:glacier_fig13",
    "glacier-hyperparameters": "papers.glacier.surveys:glacier_hyperparameters",
    "joint-map-comparison": "papers.glacier.joint_map:comparison",
    "emap-fig1": "papers.emap.figures:figure_1",
    "emap-fig2": "papers.emap.figures:figure_2",
    "emap-table1": "papers.emap.figures:table_1",
    "emap-fig4": "papers.emap.figures:figure_4",
    "emap-fig5": "papers.emap.figures:figure_5",
    "emap-fig6": "papers.emap.figures:figure_6",
    "emap-range": "papers.emap.figures:range_extension",
    "carving-fig3": "papers.carving.figures:figure_3",
    "carving-fig5": "papers.carving.figures:figure_5",
    "carving-table1": "papers.carving.comparison:table_1",
    "carving-fig7": "papers.carving.figures:figure_7",
    "carving-fig8": "papers.carving.figures:figure_8",
    "carving-fig9": "papers.carving.figures:figure_9",
    "carving-fig10": "papers.carving.figures:figure_10",
    "carving-fig11": "papers.carving.comparison:figure_11",
    "carving-fig12": "papers.carving.comparison:figure_12",
    "carving-fig13": "papers.carving.figures:figure_13",
    "carving-algorithm1": "papers.carving.comparison:algorithm_1",
}
"""Study name → its function as ``module:function``, in the order of the papers."""

LONG: dict[str, str] = {
    "glacier-fig12": "ten surveys of about 2.7 km in images, about 25 minutes of CPU each; they continue where they were stopped",
    "glacier-fig13": "the same ten surveys, which are driven once",
}
"""Studies that take more than half an hour, and why."""


def study(name: str) -> Study:
    """Return the function of a study."""
    if name not in STUDIES:
        near = difflib.get_close_matches(name, STUDIES, n=1)
        hint = f"did you mean {near[0]}?" if near else "`firnline reproduce --list` names them all."
        raise InputError(f"there is no study {name!r}; {hint}")
    module, function = STUDIES[name].split(":")
    return cast("Study", getattr(import_module(module), function))


def record(folder: Path, *, quick: bool) -> None:
    """Record that a study is complete: the version and depth that made it, and the checksums of its files."""
    files = [path for path in folder.iterdir() if path.is_file() and path.name != RECORD]
    write_record(folder, files, {"firnline": version("firnline"), "quick": quick})


def is_complete(folder: Path, *, quick: bool) -> bool:
    """Return whether a study is complete, unchanged, and made by this version of firnline."""
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
