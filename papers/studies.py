"""Reproduction of the papers' figures and tables: one study per figure, found by its name.

`STUDIES` maps names to functions. The record of a finished study holds the version and depth that made it and the
checksums of its files; a study that is complete and unchanged is not run again.
"""

import difflib
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

from papers.provenance import KEY, Began, CodeState, kept_remark
from survey.core import InputError, Progress, read_json
from survey.core.documents import RECORD, file_sha256, read_record, write_record
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
    "emap-sensitivity": "papers.emap.sensitivity:sensitivity",
    "emap-fig4": "papers.emap.sensitivity:figure_4",
    "emap-fig5": "papers.emap.figures:figure_5",
    "emap-fig6": "papers.emap.figures:figure_6",
    "emap-range": "papers.emap.figures:range_extension",
    "carving-fig3": "papers.carving.figures:figure_3",
    "carving-fig4": "papers.carving.hidden_slopes:figure_4",
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


class About(NamedTuple):
    """What a study makes, and the CPU time that it takes in full depth [min], where it was measured."""

    title: str
    cpu_min: float | None


ABOUT: dict[str, About] = {
    "glacier-fig4": About("Rendered ice beside photographs, as algorithms see it (Figs. 3 and 4)", 1.4),
    "glacier-fig5": About(
        "Maps of one traverse: mesh, Gaussian process, around the satellite's cells (Fig. 5)", None
    ),
    "glacier-fig6": About("The true terrain (Fig. 6)", 0.02),
    "glacier-fig7": About("A piecewise-continuous path (Fig. 7)", 0.02),
    "glacier-fig8": About("Coverage of four swaths: SCC, α, β (Fig. 8)", 0.01),
    "glacier-tables": About("Map classes (Tables I to III)", 0.01),
    "glacier-fig9": About("Distributions of landmarks that mislead (Fig. 9)", 0.01),
    "glacier-fig10": About("Error against swaths, eleven families of terrain (Fig. 10)", None),
    "glacier-fig11": About("Swaths that Class 3 needs (Fig. 11)", 0.9),
    "glacier-fig12": About("Both surveys driven: paths and landmarks (Fig. 12)", 250.0),
    "glacier-fig13": About("Both surveys driven: maps and errors (Fig. 13)", 250.0),
    "glacier-hyperparameters": About("Hyperparameters of least error beside the paper's (Sec. II.D)", None),
    "joint-map-comparison": About("Map and path as one estimate, beside the paper's method", None),
    "emap-fig1": About("A surface and its reconstruction (Fig. 1)", 0.04),
    "emap-fig2": About("Hits against distance (Fig. 2)", 0.02),
    "emap-table1": About("Error beside OctoMap's, four scenarios (Table 1)", 1.7),
    "emap-sensitivity": About("Table 1 under 72 settings that the paper leaves open", 36.0),
    "emap-fig4": About("Spread of raw errors over the nodes (Fig. 4)", 0.5),
    "emap-fig5": About("Error along the drive, Gaussian scenario (Fig. 5)", 2.0),
    "emap-fig6": About("Time against nodes (Fig. 6)", 0.1),
    "emap-range": About("Effective range of the scanner (Eqs. 4 and 7)", 0.4),
    "carving-fig3": About("Wu's kernel (Fig. 3)", 0.01),
    "carving-fig4": About("Slopes that the upper bound shows without points (Fig. 4)", 2.3),
    "carving-fig5": About("A sine curve between two surfaces (Fig. 5)", 0.1),
    "carving-table1": About("Error without and with lines of sight (Table I)", 0.7),
    "carving-fig7": About("Surfaces of five terrains (Fig. 7)", 0.06),
    "carving-fig8": About("Sections through surfaces and bounds (Fig. 8)", 0.04),
    "carving-fig9": About("Sections behind obstacles (Fig. 9)", 0.02),
    "carving-fig10": About("Contributions of points and lines of sight (Fig. 10)", 0.04),
    "carving-fig11": About("Error against the number of points (Fig. 11)", 0.13),
    "carving-fig12": About("Convergence (Fig. 12)", 0.07),
    "carving-fig13": About("Downhill terrain seen from above (Fig. 13)", 0.02),
    "carving-algorithm1": About("Algorithm 1 as printed, beside ours", 0.6),
}
"""Titles and times of all studies."""

LONG: dict[str, str] = {
    "glacier-fig12": "ten surveys of about 2.7 km in images, about 25 minutes of CPU each; they continue where they were stopped",
    "glacier-fig13": "the same ten surveys, which are driven once",
}
"""Studies that take more than half an hour, and why."""


def listed(name: str) -> str:
    """Return a study's name, what it makes, and the CPU time that it takes in full depth."""
    title, minutes = ABOUT[name].title, ABOUT[name].cpu_min
    if minutes is None:
        return f"{name:<24}{title}"
    time = f"{max(60.0 * minutes, 1.0):.0f} s" if minutes < 1.5 else f"{minutes:.0f} min"
    return f"{name:<24}{title}, {time if minutes < 100.0 else f'{minutes / 60.0:.1f} h'} of CPU"


def study(name: str) -> Study:
    """Return the function of a study."""
    if name not in STUDIES:
        near = difflib.get_close_matches(name, STUDIES, n=1)
        hint = f"did you mean {near[0]}?" if near else "`firnline reproduce --list` names them all."
        raise InputError(f"there is no study {name!r}; {hint}")
    module, function = STUDIES[name].split(":")
    return cast("Study", getattr(import_module(module), function))


NOT_KEPT = ("photographs.png",)
"""Pictures with photographs that may not be shown: they lie beside the files of a study, which is complete without them."""


def record(folder: Path, *, quick: bool, facts: Mapping[str, Any], old: Mapping[str, Any]) -> None:
    """Record that a study is complete: what made it, the checksums of its files, and the remark of the old record."""
    files = [path for path in folder.iterdir() if path.is_file() and path.name not in (RECORD, *NOT_KEPT)]
    is_same = {path.name: file_sha256(path) for path in files} == old.get("files_sha256")
    about = {"firnline": version("firnline"), "quick": quick, **facts}
    write_record(folder, files, about | kept_remark(old, is_same=is_same))


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
    began = Began.now(CodeState.of_today(STUDIES.get(folder.name, "")))
    with _locked(draft, folder):
        _remove_files(draft)
        yield draft
        record(draft, quick=quick, facts={KEY: began.facts(quick=quick)}, old=_old_record(folder))
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
    return {RECORD, *NOT_KEPT, *_old_record(folder).get("files_sha256", {})}


def _old_record(folder: Path) -> dict[str, Any]:
    """Return the record of a study, without a check of its files; nothing where there is none."""
    return read_json(folder / RECORD, "the record of the folder") if (folder / RECORD).exists() else {}
