"""Tag with the CRS of a GeoTIFF, because a single flipped bit of the file's own key names another zone."""

from pathlib import Path
from typing import Any

from pyproj import CRS
from pyproj.exceptions import CRSError

from survey.core.crs.agreement import equal_crs
from survey.core.errors import InputError

CRS_TAG = "FIRNLINE_CRS"


def crs_tag(crs: CRS) -> dict[str, str]:
    """Return the tag of a CRS that has a code; none for others.

    Parameters
    ----------
    crs : pyproj.CRS
        Projected.

    Returns
    -------
    dict of str to str
        At most one tag.

    Examples
    --------
    >>> crs_tag(CRS("EPSG:32608"))
    {'FIRNLINE_CRS': 'EPSG:32608'}
    """
    authority = crs.to_authority(min_confidence=100)
    return {} if authority is None else {CRS_TAG: ":".join(authority)}


def refuse_altered_crs(source: Any, file: Path) -> None:
    """Refuse an open GeoTIFF whose CRS is not that of its tag.

    Parameters
    ----------
    source : rasterio.DatasetReader
        An open raster; one without the tag passes.
    file : pathlib.Path
        Where it is, for the message.

    Raises
    ------
    InputError
        The two differ.
    """
    stated = source.tags().get(CRS_TAG)
    if stated is None or _is_same(stated, source.crs):
        return
    raise InputError(
        f"{file} states another CRS than its tag {CRS_TAG} ({stated[:40]!r}); it was changed after firnline wrote it, get it "
        "again."
    )


def _is_same(stated: str, found: Any) -> bool:
    try:
        crs = CRS.from_wkt(found.to_wkt())
        return equal_crs(CRS(stated), crs.sub_crs_list[0] if crs.is_compound else crs)
    except (CRSError, AttributeError):
        return False
