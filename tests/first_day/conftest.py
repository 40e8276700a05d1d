"""The command of an installed wheel, away from the source, and the files that three users bring.

``FIRNLINE_COMMAND`` names another command to test, such as that of an environment in which pip has installed the wheel
with all that it needs (``make wheel-check``). Without it the wheel is built and unpacked into an environment of its own,
which finds the dependencies where this Python has them and the source nowhere.
"""

import glob
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from tests.docs.scratch import make_scratch

ROOT = Path(__file__).parents[2]
Firnline = Callable[..., subprocess.CompletedProcess[str]]
_THREADS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "PYTHONSAFEPATH": "1"}
_LONGITUDE, _LATITUDE = -135.0, 60.437  # the south-west corner of the site, a kilometre around it


@pytest.fixture(scope="session")
def command(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return the words that start the command."""
    named = os.environ.get("FIRNLINE_COMMAND")
    return shlex.split(named) if named else _shared_wheel(tmp_path_factory)


def _shared_wheel(factory: pytest.TempPathFactory) -> list[str]:
    """Return the command of one environment for all workers of a test run, which share the loops that it compiles."""
    temporary = factory.getbasetemp()
    shared = (temporary.parent if "PYTEST_XDIST_WORKER" in os.environ else temporary) / "shared-wheel"
    if not shared.exists():
        built = factory.mktemp("wheel")
        _unpack_wheel(built)
        with suppress(OSError):  # another worker was faster
            built.rename(shared)
    return [str(shared / "venv" / "bin" / "python"), "-m", "firnline"]


def _unpack_wheel(place: Path) -> None:
    """Build the wheel and unpack it into an environment of its own; a wheel of pure Python needs no more."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(place)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    venv.create(place / "venv", with_pip=False)
    (packages,) = place.glob("venv/lib/python*/site-packages")
    with zipfile.ZipFile(next(place.glob("*.whl"))) as wheel:
        wheel.extractall(packages)
    _take_compiled_loops(packages)
    # A folder that is named by a .pth file is searched, and its own .pth files are not followed.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")


def _take_compiled_loops(packages: Path) -> None:
    """Copy the compiled loops of the source; they hold for files of equal size and time. What was not compiled yet is compiled."""
    for index in ROOT.glob("[a-z]*/**/__pycache__/*.nbi"):
        module = index.parent.parent / f"{index.name.partition('.')[0]}.py"
        unpacked = packages / module.relative_to(ROOT)
        if not unpacked.exists():
            continue
        shutil.copystat(module, unpacked)
        (unpacked.parent / "__pycache__").mkdir(exist_ok=True)
        for file in index.parent.glob(f"{glob.escape(index.stem)}*"):
            shutil.copy(file, unpacked.parent / "__pycache__")


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files of the documentation and elevations in degrees (``degrees.tif``)."""
    folder = tmp_path_factory.mktemp("site")
    make_scratch(folder)
    cell, n = 1.0 / 1200.0, 40
    place = Affine(2.0 * cell, 0.0, _LONGITUDE - 10 * cell, 0.0, -cell, _LATITUDE + 20 * cell)
    x, y = place @ np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5)
    heights = 800.0 + 900.0 * (x - _LONGITUDE) + 12.0 * np.sin((y - _LATITUDE) * 900.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:4326", "transform": place}
    with rasterio.open(folder / "degrees.tif", "w", height=n, width=n, **profile) as target:
        target.write(heights.astype("float32"), 1)
    return folder


@pytest.fixture
def firnline(command: list[str], site: Path, tmp_path: Path) -> Firnline:
    """Return a function that runs the command in a folder of the test, with the site's files beside it."""
    for file in site.iterdir():
        (tmp_path / file.name).symlink_to(file)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | _THREADS

    def run(*words: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [*command, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == code, done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        return done

    return run


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """Return the folder in which `firnline` runs."""
    return tmp_path
