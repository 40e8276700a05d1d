"""Facts of a raster that are read without its cells: bands, size, vertical datum."""

from pathlib import Path
from typing import Any, NamedTuple

from affine import Affine

from survey.core.crs.vertical_datum import UNSTATED
from survey.core.files.reading import existing_file
from survey.io.raster.opening import opened_dataset, opened_list_of_bands
from survey.io.raster.strips import opened_raster

VERTICAL_TAG = "VERTICAL_DATUM"


class RasterFacts(NamedTuple):
    """Rows and columns of a raster, its CRS where it names one, and its georeference."""

    shape: tuple[int, int]
    crs: Any
    transform: Affine


def stated_datum(source: Any) -> str:
    """Return the vertical datum that an open raster's tags name, or ``""``.

    Parameters
    ----------
    source : rasterio.DatasetReader
        An open raster.

    Returns
    -------
    str
        Name of the datum.
    """
    tags = source.tags()
    return str(tags.get(VERTICAL_TAG) or tags.get(f"NC_GLOBAL#{VERTICAL_TAG.lower()}") or UNSTATED)


def raster_facts(path: str | Path) -> RasterFacts:
    """Return what a raster's header says, without reading its cells.

    Parameters
    ----------
    path : str or pathlib.Path
        The raster.

    Returns
    -------
    RasterFacts
        Shape and CRS.

    Raises
    ------
    InputError
        As in `read_raster`.
    """
    with opened_raster(existing_file(path, "the raster")) as source:
        return _facts(source)


def raster_header(path: str | Path) -> RasterFacts:
    """Return what a raster's header says; damage of its cells is not looked for.

    Parameters
    ----------
    path : str or pathlib.Path
        The raster.

    Returns
    -------
    RasterFacts
        Shape, CRS and georeference.

    Raises
    ------
    InputError
        The file is missing, empty, damaged or of another kind.
    """
    with opened_dataset(existing_file(path, "the raster"), 1) as source:
        return _facts(source)


def _facts(source: Any) -> RasterFacts:
    crs = source.crs.to_wkt() if source.crs else None
    return RasterFacts((int(source.height), int(source.width)), crs, source.transform)


def band_count(path: str | Path) -> int:
    """Return the number of bands of a raster, or of variables of a NetCDF file.

    Parameters
    ----------
    path : str or pathlib.Path
        The raster.

    Returns
    -------
    int
        At least 1.
    """
    return len(band_names(path))


def band_names(path: str | Path) -> list[str]:
    """Return the names of the bands of a raster; numbered where it gives none.

    Parameters
    ----------
    path : str or pathlib.Path
        The raster.

    Returns
    -------
    list of str
        One name per band.
    """
    with opened_list_of_bands(existing_file(path, "the raster")) as source:
        if source.subdatasets:
            return [part.rsplit(":", 1)[1] for part in source.subdatasets]
        described = [d or "" for d in source.descriptions]
    if len(described) == 1 and not described[0]:
        return ["elevation"]
    return [name or f"band_{k}" for k, name in enumerate(described, start=1)]
