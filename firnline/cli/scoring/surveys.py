"""The two surveys of a change, averaged where they are too large to be compared cell by cell."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from survey import Dem, Reconstruction


class Surveys(NamedTuple):
    """Later and earlier survey, and notes on how they were read."""

    later: "Reconstruction | Dem"
    earlier: "Reconstruction | Dem"
    notes: tuple[str, ...] = ()


def surveys_of(later: Path, earlier: Path, crs: str | None) -> Surveys:
    """Read two surveys; rasters of more cells than a change in memory takes are averaged over squares."""
    from survey.scoring.change.files import average_survey, averaged_step_m

    step_m = averaged_step_m([later, earlier]) if _is_raster(later) and _is_raster(earlier) else None
    if step_m is None:
        return Surveys(_survey(later, crs), _survey(earlier, crs))
    note = f"the surveys were averaged over squares of about {step_m:.3g} m before the comparison."
    return Surveys(average_survey(later, step_m, crs), average_survey(earlier, step_m, crs), (note,))


def _is_raster(source: Path) -> bool:
    return source.is_file() and source.suffix != ".npz"


def _survey(source: Path, crs: str | None) -> "Reconstruction | Dem":
    """Read a map that is no terrain model."""
    from firnline.cli.scoring.maps import map_of
    from survey.core.errors import InputError

    if source.suffix == ".npz":
        raise InputError(
            f"{source} is a terrain model and the other survey is none; compare two models, or two maps."
        )
    return map_of(source, crs)
