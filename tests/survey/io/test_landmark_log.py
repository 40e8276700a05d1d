"""Landmarks are logged whole batch by whole batch, by one rover or four, into a file or a database."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from survey.core.errors import InputError
from survey.io.landmark_log import COLUMNS, open_landmark_log

CRS = "EPSG:32608"
BATCH, N_BATCHES, N_WRITERS = 25, 20, 4
# The packages are loaded once; every rover is a process of its own with its own connection.
WRITERS = """
import os, sys
from survey.io.landmark_log import COLUMNS, open_landmark_log
place, (rovers, batches, rows) = sys.argv[1], map(int, sys.argv[2:])
def write(rover):
    with open_landmark_log(place, "EPSG:32608") as log:
        for k in range(batches):
            numbers = [k * rows + i for i in range(rows)]
            values = {name: [float(n) for n in numbers] for name in COLUMNS}
            log.append(values | {"rover": [rover] * rows, "landmark": numbers})
            print(k, flush=True)
if rovers == 1:
    write(9)
else:
    children = []
    for rover in range(rovers):
        if (child := os.fork()) == 0:
            write(rover)
            os._exit(0)
        children.append(child)
    sys.exit(max(os.waitpid(child, 0)[1] for child in children))
"""


def writers(place: str, rovers: int, batches: int, rows: int = BATCH) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WRITERS, place, str(rovers), str(batches), str(rows)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def batch(n: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(n)
    columns = {name: rng.normal(size=n) for name in COLUMNS}
    return columns | {"rover": np.zeros(n), "landmark": np.arange(n)}


def nothing_is_lost(place: str) -> None:
    """Four rovers write at once; every row of every one is there, once."""
    process = writers(place, N_WRITERS, N_BATCHES)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    with open_landmark_log(place, CRS) as log:
        rows = log.read()
    assert len(rows["x_m"]) == N_WRITERS * N_BATCHES * BATCH
    seen = {(int(r), int(k)) for r, k in zip(rows["rover"], rows["landmark"], strict=True)}
    assert len(seen) == N_WRITERS * N_BATCHES * BATCH


def a_kill_leaves_whole_batches(place: str) -> None:
    """A writer is killed while it writes; what is there is a whole number of its batches, all that it had announced."""
    rows = 200
    process = writers(place, 1, 10_000, rows)
    assert process.stdout is not None
    announced = [int(process.stdout.readline()) for _ in range(5)][-1] + 1
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    with open_landmark_log(place, CRS) as log:
        table = log.read()
    mine = table["rover"] == 9
    n = int(mine.sum())
    assert n % rows == 0
    assert n >= announced * rows
    np.testing.assert_array_equal(np.sort(table["landmark"][mine]), np.arange(n))
    # Every row is whole: all its columns were written from one number.
    for name in COLUMNS[2:]:
        np.testing.assert_array_equal(table[name][mine], table["landmark"][mine])


def comes_back(place: str) -> None:
    first = batch(7)
    with open_landmark_log(place, CRS) as log:
        log.append(first)
        rows = log.read()
    for name in COLUMNS:
        np.testing.assert_array_equal(rows[name], first[name])


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a PostgreSQL server with PostGIS on loopback, started for these tests."""
    pytest.importorskip("psycopg", reason="psycopg is not installed (firnline[postgis])")
    versions = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    extension = sorted(Path("/usr/share/postgresql").glob("*/extension/postgis.control"))
    if not versions or not extension:
        pytest.skip(
            "PostgreSQL with PostGIS is not installed (Debian: postgresql, postgis, postgresql-*-postgis-3)"
        )
    home = Path(tmp_path_factory.mktemp("postgis"))
    tools = versions[-1].parent
    # PostgreSQL refuses to run as root.
    as_user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
    if as_user:
        for folder in (home, *home.parents):
            if folder == Path(tempfile.gettempdir()):
                break
            folder.chmod(0o755)
        shutil.chown(home, "postgres")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    data = home / "data"
    quiet = {"check": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": "/"}
    subprocess.run(
        [*as_user, tools / "initdb", "-D", data, "-A", "trust", "-U", "postgres", "--no-sync"], **quiet
    )
    options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={home} -c fsync=off"
    subprocess.run([*as_user, tools / "pg_ctl", "-D", data, "-w", "-o", options, "start"], **quiet)
    try:
        yield f"postgresql://postgres@127.0.0.1:{port}/postgres"
    finally:
        subprocess.run([*as_user, tools / "pg_ctl", "-D", data, "-m", "immediate", "stop"], **quiet)


def emptied(url: str) -> str:
    import psycopg

    with psycopg.connect(url) as connection:
        connection.execute("DROP TABLE IF EXISTS landmarks")
    return url


def test_what_is_logged_into_a_file_comes_back(tmp_path: Path) -> None:
    comes_back(str(tmp_path / "log.gpkg"))


def test_gdal_reads_the_file_with_its_points(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    with open_landmark_log(path, CRS) as log:
        log.append(batch(5))
    meta, _, geometry, _ = pyogrio.raw.read(path, layer="landmarks")
    assert meta["crs"] == CRS
    expected = batch(5)
    places = shapely.get_coordinates(shapely.from_wkb(geometry), include_z=True)
    np.testing.assert_array_equal(places, np.column_stack([expected[n] for n in ("x_m", "y_m", "z_m")]))


@pytest.mark.reliability
def test_a_killed_writer_leaves_whole_batches_in_a_file(tmp_path: Path) -> None:
    a_kill_leaves_whole_batches(str(tmp_path / "log.gpkg"))


def test_what_is_logged_into_postgis_comes_back(database: str) -> None:
    comes_back(emptied(database))


@pytest.mark.reliability
def test_four_writers_lose_nothing_in_postgis(database: str) -> None:
    nothing_is_lost(emptied(database))


@pytest.mark.reliability
def test_a_killed_writer_leaves_whole_batches_in_postgis(database: str) -> None:
    a_kill_leaves_whole_batches(emptied(database))


def test_postgis_keeps_points_in_their_crs(database: str) -> None:
    import psycopg

    comes_back(emptied(database))
    with psycopg.connect(database) as connection:
        row = connection.execute("SELECT ST_SRID(geom), ST_Z(geom), z_m FROM landmarks LIMIT 1").fetchone()
    assert row is not None
    assert (row[0], row[1]) == (32608, row[2])
    with pytest.raises(InputError, match="EPSG:32608"):
        open_landmark_log(database, "EPSG:32609")


def test_refusals(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    with open_landmark_log(path, CRS) as log:
        with pytest.raises(InputError, match="lack landmark"):
            log.append({n: [1.0] for n in COLUMNS if n != "landmark"})
        with pytest.raises(InputError, match="NaN"):
            log.append({n: [np.nan] for n in COLUMNS})
        with pytest.raises(InputError, match="fractions"):
            log.append({n: [0.5] for n in COLUMNS})
        assert len(log.read()["x_m"]) == 0
    with pytest.raises(InputError, match="EPSG:32608"):
        open_landmark_log(path, "EPSG:32609")
    with pytest.raises(InputError, match=r"\.gpkg"):
        open_landmark_log(tmp_path / "log.csv", CRS)
    (tmp_path / "bad.gpkg").write_bytes(b"no database")
    with pytest.raises(InputError, match="not a database"):
        open_landmark_log(tmp_path / "bad.gpkg", CRS)
    pytest.importorskip("psycopg", reason="psycopg is not installed (firnline[postgis])")
    with pytest.raises(InputError, match="PostGIS could not be opened"):
        open_landmark_log("postgresql://postgres@127.0.0.1:1/none", CRS)
