"""No data file opens a connection or reads a file other than its own, whatever stands in it."""

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from sim.mission.runs import open_run, read_mission
from survey import Dem, SurveyArea
from survey.core.errors import FirnlineError
from survey.data.surface_points import SurfacePoints
from survey.io.raster import band_count, raster_facts
from survey.io.trajectory_files import read_track
from survey.scoring.scores import score_files
from tests.reliability.bait.places import UTM, Places, laid
from tests.reliability.bait.rasters import RASTERS, tif, wms
from tests.reliability.bait.vectors import ANSWERS, VECTORS, ogr_vrt

pytestmark = pytest.mark.reliability


@pytest.fixture
def contacts() -> Iterator[tuple[str, list[bytes]]]:
    """Listen on a local port, and note whoever connects."""
    found: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.05)
        closing = threading.Event()

        def listen() -> None:
            while not closing.is_set():
                try:
                    visitor, _ = server.accept()
                except TimeoutError:
                    continue
                with visitor:
                    visitor.settimeout(1.0)
                    found.append(visitor.recv(200))
                    visitor.sendall(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")

        thread = threading.Thread(target=listen)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}", found
        closing.set()
        thread.join()


def refused(read: Callable[[], object]) -> bool:
    try:
        read()
    except FirnlineError as refusal:
        return "\n" not in str(refusal)
    return False


@pytest.mark.parametrize("name", RASTERS)
def test_no_raster_leads_elsewhere(name: str, tmp_path: Path, contacts: tuple[str, list[bytes]]) -> None:
    url, found = contacts
    file = laid(RASTERS[name], tmp_path, url)
    good = tif(tmp_path / "good.tif")
    for read in (
        lambda: Dem.read(file, crs=UTM),
        lambda: Dem.read(file, crs=UTM, band=2),
        lambda: raster_facts(file),
        lambda: band_count(file),
        lambda: score_files(file, good),
        lambda: score_files(good, file),
    ):
        assert refused(read) or name == "tif_with_address_of_overviews"
    assert found == []


@pytest.mark.parametrize("name", VECTORS)
def test_no_vector_file_leads_elsewhere(name: str, tmp_path: Path, contacts: tuple[str, list[bytes]]) -> None:
    url, found = contacts
    file = laid(VECTORS[name], tmp_path, url)
    for read in (
        lambda: SurveyArea.read(file, crs=UTM),
        lambda: SurfacePoints.read(file, crs=UTM),
        lambda: read_track(file, CRS(UTM)),
    ):
        assert refused(read) or name in ANSWERS
    assert found == []


@pytest.mark.parametrize(
    "crs",
    [
        "+proj=utm +zone=8 +nadgrids={url}/x.gsb",
        "+proj=utm +zone=8 +nadgrids={canary}",
        "+init={canary}:x",
        "{url}/crs",
        "{canary}",
    ],
)
def test_no_crs_of_a_point_file_leads_elsewhere(
    crs: str, tmp_path: Path, contacts: tuple[str, list[bytes]]
) -> None:
    url, found = contacts
    header = "ply\nformat ascii 1.0\ncomment crs {}\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\nend_header\n1 2 3\n"

    def write(folder: Path, places: Places) -> Path:
        (folder / "a.ply").write_text(header.format(crs.format(url=places.url, canary=places.canary)))
        return folder / "a.ply"

    assert refused(lambda: SurfacePoints.read(laid(write, tmp_path, url)))
    assert found == []


@pytest.mark.parametrize("name", ["terrain", "area"])
def test_no_mission_leads_elsewhere(name: str, tmp_path: Path, contacts: tuple[str, list[bytes]]) -> None:
    url, found = contacts
    tif(tmp_path / "dem.tif")
    (tmp_path / "terrain.tif").write_text(wms(url))
    (tmp_path / "area.geojson").write_text(ogr_vrt(Places(url, tmp_path)))
    dem = "terrain.tif" if name == "terrain" else "dem.tif"
    (tmp_path / "m.toml").write_text(
        f'schema_version = 1\nname = "m"\n[terrain]\nsource = "dem"\nfile = "{dem}"\n[satellite]\ncell_m = 50.0\n'
        '[planner]\npattern = "lawnmower"\nswaths = 2\n[area]\nfile = "area.geojson"\n'
    )
    assert refused(lambda: open_run(read_mission(tmp_path / "m.toml"), tmp_path / "runs"))
    assert found == []


def test_arrays_are_never_unpickled(tmp_path: Path) -> None:
    from survey.io.arrays_file import read_arrays

    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return os.system, (f"touch {tmp_path / 'ran'}",)

    np.savez(tmp_path / "a.npz", facts=np.array([Bomb()], dtype=object))
    (tmp_path / "ran").unlink(missing_ok=True)
    assert refused(lambda: read_arrays(tmp_path / "a.npz", "x"))
    assert not (tmp_path / "ran").exists()


def test_the_vectors_are_many() -> None:
    assert len(RASTERS) + len(VECTORS) >= 20


_TRANSFORMED = """
import numpy as np
import rasterio.warp
from pyproj import CRS
from survey.core.transformation import transformed

transformed(np.array([[-100.0, 40.0]]), "EPSG:4267", CRS("EPSG:32614"), "the test")
rasterio.warp.transform("EPSG:4267", "EPSG:32614", [-100.0], [40.0])
"""


@pytest.mark.parametrize("allowed", [False, True])
def test_a_crs_that_needs_a_grid_downloads_none_unless_it_is_allowed(tmp_path, contacts, allowed):
    url, found = contacts
    environment = {
        **os.environ,
        "PROJ_NETWORK": "ON",
        "PROJ_NETWORK_ENDPOINT": url,
        "PROJ_USER_WRITABLE_DIRECTORY": str(tmp_path),
        "FIRNLINE_PROJ_NETWORK": "ON" if allowed else "",
    }
    subprocess.run(
        [sys.executable, "-c", _TRANSFORMED], env=environment, check=not allowed, capture_output=True
    )
    assert bool(found) == allowed
