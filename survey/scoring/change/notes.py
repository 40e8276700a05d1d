"""Sentences about the assumptions behind a change."""

from collections.abc import Iterable

from survey.core.map_scale import MapScale
from survey.core.text import printable
from survey.data.dem import Dem
from survey.scoring.change.results import VolumeChange

# Outlines that are mapped to a smaller share get a note.
_MAPPED = 0.99


def datum_notes(*datums: str) -> tuple[str, ...]:
    """Return a note where a survey states no vertical datum."""
    if all(datums):
        return ()
    return ("a survey does not state its vertical datum; check that both count from the same",)


def scale_notes(dem: Dem) -> tuple[str, ...]:
    """Return a note where lengths in the CRS differ by more than 1 % from those on the ground."""
    warning = MapScale.over(dem.crs, dem.bounds).warning
    return (warning,) if warning else ()


def coverage_notes(volumes: Iterable[VolumeChange]) -> tuple[str, ...]:
    """Return a note for each outline of which a survey does not map a part."""
    return tuple(
        f"both surveys map {one.known_share:.0%} of {printable(one.name)}; the mean change of that part is taken for all of it, "
        "and its standard deviation for the error of the rest"
        for one in volumes
        if one.known_share < _MAPPED
    )
