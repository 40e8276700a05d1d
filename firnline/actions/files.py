"""Checks of the output files of an action, and reading of its rasters.

Outputs are checked before any work starts. Rasters are read about an area, in its CRS, and warped where they are in degrees.
"""

import os
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyproj import CRS

    import survey
    from survey.core.arrays import Bounds


def refuse_existing(
    outputs: Iterable[Path],
    *,
    force: bool,
    inputs: Iterable[Path | None] = (),
    own: Collection[str] = (),
) -> None:
    """Refuse outputs that exist, that are inputs, or that cannot be written.

    Parameters
    ----------
    outputs : iterable of pathlib.Path
        Every file or folder that the command will write, companions included (``route.png``).
        An empty folder counts as missing.
    force : bool
        Whether an output that exists may be replaced. An input is never replaced.
    inputs : iterable of pathlib.Path or None
        Every file or folder that the command reads; None stands for an option that was not given.
    own : collection of str
        For output folders: patterns of the files that the command writes there, as for
        `survey.core.files.replacing.replacing_folder`. Without them all outputs are files.

    Raises
    ------
    InputError
        One sentence that names the output and what to do.
    """
    from survey.core.files.links import resolved
    from survey.core.files.replacing import refuse_unwritable

    given = [resolved(path) for path in inputs if path is not None]
    for output in outputs:
        _refuse_input(output, given)
        refuse_unwritable(output, is_folder=bool(own))
        _refuse_present(output, force=force, own=own)


def with_companions(inputs: Iterable[Path | None]) -> list[Path]:
    """Return input files with the files beside them that are read too (``.prj``, ``.dbf`` …).

    Parameters
    ----------
    inputs : iterable of pathlib.Path or None
        Files or folders that a command reads; None stands for an option that was not given.

    Returns
    -------
    list of pathlib.Path
        Inputs that exist, each followed by its companions.
    """
    from survey.io.companions import companion_files

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

    Parameters
    ----------
    output : pathlib.Path
        The main file.

    Returns
    -------
    list of pathlib.Path
        For ``.asc`` the ``.prj``, for ``.shp`` the tables, index and CRS; none for other formats.
    """
    suffixes = {".asc": (".prj",), ".shp": (".shx", ".dbf", ".prj", ".cpg")}.get(output.suffix.lower(), ())
    return [output.with_suffix(suffix) for suffix in suffixes]


def _refuse_input(output: Path, inputs: Iterable[Path]) -> None:
    from survey.core.errors import InputError
    from survey.core.files.links import resolved

    place = resolved(output)
    for path in inputs:
        if path == place or place in path.parents:
            raise InputError(
                f"the output {output} is or contains the input {path}; choose another place for the output."
            )


def _refuse_present(output: Path, *, force: bool, own: Collection[str]) -> None:
    from survey.core.errors import InputError
    from survey.core.files.replacing import refuse_foreign

    if not os.path.lexists(output):
        return
    is_folder = output.is_dir()
    if not force and not (is_folder and not any(output.iterdir())):
        raise InputError(f"{output} exists; choose another name or add --force to replace it.")
    if own:
        refuse_foreign(output, own)
    elif is_folder:
        raise InputError(f"{output} is a folder, and a file was to be written; choose another name.")


_LEAST_MARGIN_M = 200.0
_MARGIN_CELLS = 4.0


def own_crs(path: Path) -> "CRS | None":
    """Return the projected CRS that a raster's header names; None where it is in degrees."""
    from survey.core.crs.checks import projected_crs
    from survey.core.crs.choice import is_geographic
    from survey.io.raster import raster_header

    stated = raster_header(path).crs
    return None if is_geographic(stated) else projected_crs(stated, str(path))


def read_about(path: Path, bounds: "Bounds", crs: "CRS", what: str, *, mask: bool = False) -> "survey.Dem":
    """Read the cells of a raster on bounds [m] and about them, as far as slopes and cameras reach.

    Raises
    ------
    InputError
        The raster is in another projected CRS, or lies elsewhere.
    CapacityError
        More cells on the bounds than planning accepts.
    """
    import survey
    from planners.capacity import require_cells
    from survey.core.crs.agreement import same_crs
    from survey.io.raster.warping import cell_m

    stated = own_crs(path)
    if stated is not None:
        same_crs(crs, stated, f"the survey area and {what}")
    west, south, east, north = bounds
    step_m = cell_m(path, crs)
    if step_m > 0.0:  # a turned raster is refused when it is read
        require_cells(int((east - west) * (north - south) / step_m**2))
    margin_m = max(_MARGIN_CELLS * step_m, _LEAST_MARGIN_M)
    about = (west - margin_m, south - margin_m, east + margin_m, north + margin_m)
    return survey.Dem.read(path, crs=crs if stated is None else None, bounds=about, mask=mask)
