"""Landmarks as they are found, in a GeoPackage of one's own or a PostGIS that several rovers share.

A batch is there whole or not at all, whenever its writer dies.
"""

import sqlite3
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
import shapely
from pyproj import CRS

from survey.core.arrays import FloatArray, checked
from survey.core.errors import InputError
from survey.core.files import first_line
from survey.core.geodesy import projected_crs
from survey.io.vector import write_features

TABLE = "landmarks"
COLUMNS = (
    "rover",
    "landmark",
    "time_s",
    "x_m",
    "y_m",
    "z_m",
    "cov_xx_m2",
    "cov_xy_m2",
    "cov_xz_m2",
    "cov_yy_m2",
    "cov_yz_m2",
    "cov_zz_m2",
)
"""What is logged of a landmark: who saw it, its number there, when, where, how surely."""
_COUNTS = COLUMNS[:2]
_BUSY_S = 60.0


class LandmarkLog(Protocol):
    """Where landmarks are logged; used as a context manager."""

    def append(self, columns: Mapping[str, Any]) -> None:
        """Log a batch of equally long `COLUMNS`, all of it or nothing."""

    def read(self) -> dict[str, FloatArray]:
        """Return all that was logged, by rover, landmark and time."""

    def close(self) -> None:
        """Let go of the file or the connection."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


def open_landmark_log(place: str | Path, crs: Any) -> LandmarkLog:
    """Open a log, made anew where there is none.

    Parameters
    ----------
    place : str or pathlib.Path
        A ``.gpkg`` file, or ``postgresql://user@host/database`` with PostGIS.
    crs : str or pyproj.CRS
        Projected, in metres, and with an EPSG code.

    Raises
    ------
    InputError
        A place that cannot be opened, a log in another CRS.

    Examples
    --------
    >>> import tempfile
    >>> batch = {name: [1.0, 2.0] for name in COLUMNS}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open_landmark_log(Path(folder) / "log.gpkg", "EPSG:32608") as log:
    ...         log.append(batch)
    ...         len(log.read()["x_m"])
    2
    """
    code = projected_crs(crs, "the landmark log").to_epsg()
    if code is None:
        raise InputError("the landmark log needs a CRS with an EPSG code; name one, e.g. EPSG:32608.")
    if str(place).startswith(("postgresql://", "postgres://")):
        return PostgisLog(str(place), code)
    return GeoPackageLog(Path(place), code)


class GeoPackageLog:
    """A log in a GeoPackage, which is an SQLite database: GIS programs open it while it grows."""

    def __init__(self, path: Path, epsg: int) -> None:
        self.path, self._epsg = path, epsg
        if path.suffix.lower() != ".gpkg":
            raise InputError(f"{path.name} ends in {path.suffix!r}; a landmark log ends in .gpkg.")
        if not path.exists():
            _make_geopackage(path, epsg)
        with self._told("opened"):
            self._database = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None)
            self._srs = self._found_srs()

    def append(self, columns: Mapping[str, Any]) -> None:
        """Log a batch of equally long `COLUMNS`, all of it or nothing."""
        rows = _rows(columns)
        shapes = [_gpkg_point(self._srs, row[3:6]) for row in rows]
        names = ", ".join(name for name in COLUMNS)
        marks = ", ".join("?" * (len(COLUMNS) + 1))
        with self._told("written to"):
            self._database.execute("BEGIN IMMEDIATE")
            try:
                self._database.executemany(
                    f"INSERT INTO {TABLE} (geom, {names}) VALUES ({marks})",
                    [(shape, *row) for shape, row in zip(shapes, rows, strict=True)],
                )
            except BaseException:
                self._database.execute("ROLLBACK")
                raise
            self._database.execute("COMMIT")

    def read(self) -> dict[str, FloatArray]:
        """Return all that was logged, by rover, landmark and time."""
        with self._told("read"):
            rows = self._database.execute(
                f"SELECT {', '.join(COLUMNS)} FROM {TABLE} ORDER BY rover, landmark, time_s, fid"
            ).fetchall()
        return _table(rows)

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _found_srs(self) -> int:
        query = "SELECT srs_id FROM gpkg_geometry_columns WHERE table_name = ?"
        found = self._database.execute(query, (TABLE,)).fetchone()
        if found is None:
            raise InputError(f"{self.path} holds no table {TABLE}; name another file.")
        if int(found[0]) != self._epsg:
            raise InputError(
                f"the landmark log {self.path} is in EPSG:{found[0]}, not EPSG:{self._epsg}; name another file."
            )
        return int(found[0])

    @contextmanager
    def _told(self, what: str) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise InputError(
                f"the landmark log {self.path} could not be {what} ({first_line(error)}); check the file and its folder."
            ) from error


class PostgisLog:
    """A log in a PostGIS database, into which several rovers write at once."""

    def __init__(self, url: str, epsg: int) -> None:
        try:
            import psycopg
        except ImportError as error:
            raise InputError(
                "a log in PostGIS needs psycopg, which is not installed; install firnline[postgis]."
            ) from error
        self._faults, self._epsg = psycopg.Error, epsg
        with self._told("opened"):
            self._connection = psycopg.connect(url, autocommit=True)
        try:
            self._make_table()
        except BaseException:
            self._connection.close()
            raise

    def append(self, columns: Mapping[str, Any]) -> None:
        """Log a batch of equally long `COLUMNS`, all of it or nothing."""
        rows = _rows(columns)
        names = ", ".join(COLUMNS)
        place = f"ST_SetSRID(ST_MakePoint(%s, %s, %s), {self._epsg})"
        marks = ", ".join(["%s"] * len(COLUMNS))
        with self._told("written to"), self._connection.transaction(), self._connection.cursor() as cursor:
            cursor.executemany(
                f"INSERT INTO {TABLE} (geom, {names}) VALUES ({place}, {marks})".encode(),
                [(*row[3:6], *row) for row in rows],
            )

    def read(self) -> dict[str, FloatArray]:
        """Return all that was logged, by rover, landmark and time."""
        query = f"SELECT {', '.join(COLUMNS)} FROM {TABLE} ORDER BY rover, landmark, time_s, fid"
        with self._told("read"):
            return _table(self._connection.execute(query.encode()).fetchall())

    def close(self) -> None:
        """Let go of the connection."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _make_table(self) -> None:
        """Make the table once, however many rovers ask at the same moment; refuse one in another CRS."""
        types = ", ".join(
            f"{name} {'bigint' if name in _COUNTS else 'double precision'} NOT NULL" for name in COLUMNS
        )
        make = (
            f"CREATE TABLE IF NOT EXISTS {TABLE} (fid bigserial PRIMARY KEY, "
            f"geom geometry(PointZ, {self._epsg}) NOT NULL, {types})"
        )
        with self._told("opened"), self._connection.transaction():
            self._connection.execute(b"SELECT pg_advisory_xact_lock(7463826)")
            self._connection.execute(b"CREATE EXTENSION IF NOT EXISTS postgis")
            self._connection.execute(make.encode())
            query = "SELECT srid FROM geometry_columns WHERE f_table_schema = current_schema() AND f_table_name = %s"
            found = self._connection.execute(query, (TABLE,)).fetchone()
        if found is not None and int(found[0]) != self._epsg:
            raise InputError(
                f"the landmark log in PostGIS is in EPSG:{found[0]}, not EPSG:{self._epsg}; name another database."
            )

    @contextmanager
    def _told(self, what: str) -> Iterator[None]:
        try:
            yield
        except self._faults as error:
            raise InputError(
                f"the landmark log in PostGIS could not be {what} ({first_line(error)}); check the server and the address."
            ) from error


def _make_geopackage(path: Path, epsg: int) -> None:
    """Write an empty table; without a spatial index, whose triggers need functions that SQLite lacks."""
    columns = {name: np.zeros(0, dtype=np.int64 if name in _COUNTS else np.float64) for name in COLUMNS}
    write_features(path, [], columns, CRS.from_epsg(epsg), layer=TABLE, kind="Point Z", indexed=False)


def _rows(columns: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        raise InputError(f"the landmarks lack {', '.join(missing)}; give all columns.")
    n = len(np.atleast_1d(np.asarray(columns[COLUMNS[0]])))
    checked_columns = [checked(columns[name], (n,), f"the landmarks' {name}").tolist() for name in COLUMNS]
    for index, name in enumerate(_COUNTS):
        checked_columns[index] = [int(value) for value in checked_columns[index]]
        if checked_columns[index] != np.asarray(columns[name], dtype=np.float64).tolist():
            raise InputError(f"the landmarks' {name} holds fractions; whole numbers were expected.")
    return list(zip(*checked_columns, strict=True))


def _table(rows: list[Any]) -> dict[str, FloatArray]:
    array = np.array(rows, dtype=np.float64).reshape(-1, len(COLUMNS))
    return {name: array[:, k].copy() for k, name in enumerate(COLUMNS)}


def _gpkg_point(srs: int, xyz: tuple[float, ...]) -> bytes:
    """Return a point in GeoPackage's binary form: magic, version, flags (little-endian, no envelope), CRS, WKB."""
    wkb: bytes = shapely.to_wkb(shapely.Point(xyz), byte_order=1, flavor="iso")
    return b"GP" + struct.pack("<BBi", 0, 1, srs) + wkb
