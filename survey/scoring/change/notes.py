"""Sentences about the assumptions behind a change."""

from survey.core.map_scale import MapScale
from survey.data.dem import Dem


def datum_notes(*datums: str) -> tuple[str, ...]:
    """Return a note where a survey states no vertical datum."""
    if all(datums):
        return ()
    return ("a survey does not state its vertical datum; check that both count from the same",)


def scale_notes(dem: Dem) -> tuple[str, ...]:
    """Return a note where lengths in the CRS differ by more than 1 % from those on the ground."""
    warning = MapScale.over(dem.crs, dem.bounds).warning
    return (warning,) if warning else ()
