"""Files beside a data file whose bytes decide what is read from it: georeference, masks, attributes, sources."""

from pathlib import Path

from survey.core.files.reading import existing_file
from survey.io.vrt import raster_sources

# What stands beside a raster, by the whole name or by the name without its suffix.
_RASTER_BY_NAME = (".aux.xml", ".msk", ".aux", ".prj")
_RASTER_BY_STEM = (".aux.xml", ".aux", ".prj", ".wld", ".tab", ".hdr", ".clr", ".stx")
_VECTOR_BY_STEM = {".shp": (".shx", ".dbf", ".prj", ".cpg", ".cst")}
# SQLite writes changes that are not yet in the main file beside it.
_VECTOR_BY_NAME = {".gpkg": ("-wal", "-journal")}
_STALE_BY_NAME = (".aux.xml", ".msk", ".ovr", "-wal", "-journal", "-shm")
_STALE_BY_STEM = {".shp": (".shx", ".dbf", ".prj", ".cpg", ".cst", ".qix", ".sbn", ".sbx"), ".asc": (".prj",)}
_ALONE = frozenset(
    (".csv", ".geojson", ".gpx", ".json", ".kml", ".las", ".laz", ".npz", ".ply", ".toml", ".txt", ".tum")
)


def companion_files(path: str | Path) -> list[Path]:
    """List every other file whose bytes decide what is read from a data file.

    Parameters
    ----------
    path : str or pathlib.Path
        A raster, a vector file or a table of points; the kind follows from its suffix.

    Returns
    -------
    list of pathlib.Path
        Existing files, without `path` itself, in a fixed order: what stands beside it (``.prj``,
        ``.aux.xml``, world files, masks, ``.dbf``, ``.shx``, SQLite's journals, …) and, for a ``.vrt``, its
        sources with what stands beside these. Overviews are left out where they are not
        read, which is but for sources of a ``.vrt``.

    Raises
    ------
    InputError
        `path` does not exist, or is a virtual raster whose sources are not local files.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("dem.asc", "dem.prj", "dem.asc.aux.xml", "dem_2.prj"):
    ...     _ = (folder / name).write_text("x")
    >>> [file.name for file in companion_files(folder / "dem.asc")]
    ['dem.asc.aux.xml', 'dem.prj']
    """
    file = existing_file(path, "the file")
    found = dict.fromkeys(files_beside(file))
    if file.suffix.lower() == ".vrt":
        for source in raster_sources(file):
            # A mosaic that changes the resolution reads the overviews of its sources.
            found.update(dict.fromkeys((source, *files_beside(source, overviews=True))))
    found.pop(file, None)
    return list(found)


def files_beside(file: Path, *, overviews: bool = False) -> list[Path]:
    """List the files of one data set with `file`: those in its folder whose names follow from its own.

    Parameters
    ----------
    file : pathlib.Path
        The main file.
    overviews : bool
        Whether to list overviews as well.

    Returns
    -------
    list of pathlib.Path
        Existing files in order of their names, `file` itself not.
    """
    names = _companion_names(file)
    if names and overviews:
        names |= {f"{file.name.lower()}.ovr"}
    if not names:
        return []
    return sorted(other for other in file.parent.iterdir() if other.name.lower() in names and other.is_file())


def stale_files(path: str | Path) -> list[Path]:
    """List the files that belong to the file at `path` alone, and are wrong once it is replaced.

    Parameters
    ----------
    path : str or pathlib.Path
        A raster or vector file, existing or not.

    Returns
    -------
    list of pathlib.Path
        Metadata, masks, overviews, journals and indices; not what files of another suffix may share.
    """
    file = Path(path)
    name, stem, suffix = file.name.lower(), file.stem.lower(), file.suffix.lower()
    names = {name + ending for ending in _STALE_BY_NAME}
    names |= {stem + ending for ending in _STALE_BY_STEM.get(suffix, ())}
    if not file.parent.is_dir():
        return []
    return sorted(other for other in file.parent.iterdir() if other.name.lower() in names and other.is_file())


def _companion_names(file: Path) -> frozenset[str]:
    """Return the names, in lower case, of all files that may stand beside a data file."""
    name, stem, suffix = file.name.lower(), file.stem.lower(), file.suffix.lower()
    if suffix in _ALONE:
        return frozenset()
    if suffix in _VECTOR_BY_STEM:
        return frozenset(stem + ending for ending in _VECTOR_BY_STEM[suffix])
    if suffix in _VECTOR_BY_NAME:
        return frozenset(name + ending for ending in _VECTOR_BY_NAME[suffix])
    names = {name + ending for ending in _RASTER_BY_NAME} | {stem + ending for ending in _RASTER_BY_STEM}
    return frozenset((names | _world_files(stem, suffix)) - {name})


def _world_files(stem: str, suffix: str) -> set[str]:
    """Return the names of world files: ``a.tfw``, ``a.tifw``."""
    letters = suffix.removeprefix(".")
    return {f"{stem}.{letters[0]}{letters[-1]}w", f"{stem}.{letters}w"} if letters else set()
