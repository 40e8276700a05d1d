"""Checks of a command's outputs, made before any work starts."""

import os
from collections.abc import Collection, Iterable
from pathlib import Path


def refuse_existing(
    outputs: Iterable[Path],
    *,
    force: bool,
    inputs: Iterable[Path | None] = (),
    own: Collection[str] = (),
) -> None:
    """Refuse outputs that exist, that are inputs, or that cannot be written."""
    from survey.core.replacement import refuse_unwritable, resolved

    given = [resolved(path) for path in inputs if path is not None]
    for output in outputs:
        _refuse_input(output, given)
        refuse_unwritable(output, is_folder=bool(own))
        _refuse_present(output, force=force, own=own)


def with_companions(inputs: Iterable[Path | None]) -> list[Path]:
    """Return input files with the files beside them that are read too (``.prj``, ``.dbf`` …)."""
    from survey.io.dataset_files import companion_files

    found: list[Path] = []
    for path in inputs:
        if path is None:
            continue
        found.append(path)
        if path.is_file() and path.stat().st_size:
            found += companion_files(path)
    return found


def companions_of_output(output: Path) -> list[Path]:
    """Return the files that a format of several files has beside its main file.

    Returns: for ``.asc`` the ``.prj``, for ``.shp`` the tables, index and CRS; none for other formats.
    """
    suffixes = {".asc": (".prj",), ".shp": (".shx", ".dbf", ".prj", ".cpg")}.get(output.suffix.lower(), ())
    return [output.with_suffix(suffix) for suffix in suffixes]


def _refuse_input(output: Path, inputs: Iterable[Path]) -> None:
    from survey.core.errors import InputError
    from survey.core.replacement import resolved

    place = resolved(output)
    for path in inputs:
        if path == place or place in path.parents:
            raise InputError(
                f"the output {output} is or contains the input {path}; choose another place for the output."
            )


def _refuse_present(output: Path, *, force: bool, own: Collection[str]) -> None:
    from survey.core.errors import InputError
    from survey.core.replacement import refuse_foreign

    if not os.path.lexists(output):
        return
    is_folder = output.is_dir()
    if not force and not (is_folder and not any(output.iterdir())):
        raise InputError(f"{output} exists; choose another name or add --force to replace it.")
    if own:
        refuse_foreign(output, own)
    elif is_folder:
        raise InputError(f"{output} is a folder, and a file was to be written; choose another name.")
