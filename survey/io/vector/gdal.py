"""GDAL's bindings for vector files: without network, with the options under which files are read and written."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from survey.io.file_kinds import OFFLINE

_GDAL_OPTIONS = {
    **OFFLINE,
    # GeoPackages carry the time of their last change; a fixed one keeps equal content equal to the byte.
    "OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z",
    # A ring that is not closed is refused, not closed behind the user's back.
    "OGR_GEOMETRY_ACCEPT_UNCLOSED_RING": "NO",
}


@contextmanager
def gdal_bindings() -> Iterator[Any]:
    """Yield the bindings to GDAL, without network; options that others have set come back afterwards."""
    import pyogrio  # loaded when first needed: maps from arrays do without its 30 MB

    before = {name: pyogrio.get_gdal_config_option(name) for name in _GDAL_OPTIONS}
    pyogrio.set_gdal_config_options(_GDAL_OPTIONS)
    try:
        yield pyogrio
    finally:
        pyogrio.set_gdal_config_options(before)


def gdal_faults() -> tuple[type[Exception], ...]:
    """Return what reading and writing through GDAL may raise."""
    from pyogrio import errors as e

    return (
        e.DataSourceError,
        e.DataLayerError,
        e.FeatureError,
        e.GeometryError,
        e.FieldError,
        e.CRSError,
        ValueError,
    )
