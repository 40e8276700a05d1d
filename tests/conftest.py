"""Worlds with known answers, and the place of the real data."""

import gc
import os
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer.testing
from hypothesis import settings
from threadpoolctl import threadpool_limits

from survey import Dem, Grid

CRS = "EPSG:32608"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

# The same random examples in every run, however slow the machine is.
settings.register_profile("firnline", derandomize=True, deadline=None)
settings.load_profile("firnline")


EXHAUSTIVE = Path(__file__).with_name("exhaustive.txt")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of ``exhaustive.txt`` before any are chosen by their marks."""
    listed = {line for line in EXHAUSTIVE.read_text().splitlines() if not line.startswith("#")}
    for item in items:
        if item.nodeid in listed or item.nodeid.partition("[")[0] in listed:
            item.add_marker(pytest.mark.exhaustive)


def pytest_collection_finish() -> None:
    """Leave modules and collected tests out of the garbage collector's passes, which took 4 % of the suite's time."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 10)


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> Iterator[None]:
    """Two threads that wait for one another by spinning are slower than one."""
    with threadpool_limits(limits=1):
        yield


@pytest.fixture(scope="session", autouse=True)
def commands_once() -> Iterator[None]:
    """Build the commands of an application once, not at every call of a runner."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", cache(typer.testing._get_command))
        yield


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261121)


@pytest.fixture
def plane() -> Dem:
    """z = 100 + 0.1 x − 0.2 y on 21 × 11 nodes, 5 m apart."""
    grid = Grid((0.0, 0.0, 100.0, 50.0), 5.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, 100.0 + 0.1 * x - 0.2 * y)


@pytest.fixture
def cosine_hill() -> Dem:
    """z = 50 + 5 cos(2π x / 200) cos(2π y / 200) on 101 × 101 nodes, 2 m apart."""
    grid = Grid((0.0, 0.0, 200.0, 200.0), 2.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, 50.0 + 5.0 * np.cos(2 * np.pi * x / 200) * np.cos(2 * np.pi * y / 200))


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of measured data, named by FIRNLINE_DATA or beside the checkout."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("FIRNLINE_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"the folder of real data {folder} is not here; set FIRNLINE_DATA")
    return folder


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    """One browser for all tests, driven by playwright: Chromium where it is installed."""
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        # Loaded machines are slow.
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"], timeout=120_000)
        yield opened
        opened.close()
