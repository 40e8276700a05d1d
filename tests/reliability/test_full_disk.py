"""A full disk or a forbidden place ends in one sentence; complete stages stay as they were."""

import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from click.testing import Result
from typer.testing import CliRunner

from benchmarks.small_inputs import IDEAL_MISSION
from firnline.cli.main import app
from survey.core.run_folder import STAGES


@contextmanager
def largest_file(n_bytes: int) -> Iterator[None]:
    """Let files beyond the size fail to be written, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def run(runs: str = "runs", until: str = "report") -> Result:
    return CliRunner().invoke(app, ["run", "m.toml", "--runs", runs, "--until", until, "-q"])


def said(result: Result) -> str:
    assert result.exit_code == 3, result.stderr
    assert "Traceback" not in result.stderr
    # GDAL may add warnings of its own; firnline says one sentence.
    (sentence,) = [line for line in result.stderr.splitlines() if line.startswith("firnline: ")]
    return sentence


@pytest.mark.long
@pytest.mark.reliability
@pytest.mark.parametrize(
    ("n_bytes", "last_complete_stage", "until"), [(9_000, 0, "plan"), (150_000, 5, "report")]
)
def test_a_full_disk_is_named_and_the_mission_goes_on_afterwards(
    tmp_path, monkeypatch, n_bytes, last_complete_stage, until
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.toml").write_text(IDEAL_MISSION)
    # 9 kB hold no GeoPackage, 150 kB hold everything but the report's pictures.
    with largest_file(n_bytes):
        result = run()
    assert "space" in said(result)
    folder = next(p for p in (tmp_path / "runs" / "small").iterdir() if not p.is_symlink())
    stages = sorted(p.name for p in folder.iterdir() if p.is_dir())
    assert stages == [f"{n}-{name}" for n, name in enumerate(STAGES[:last_complete_stage], start=1)]
    assert run(until=until).exit_code == 0


@pytest.mark.reliability
def test_a_raster_that_does_not_fit_is_refused(tmp_path):
    write = (
        "import resource, numpy as np\n"
        "from survey import Dem, Grid, InputError\n"
        "grid = Grid((0.0, 0.0, 600.0, 600.0), 1.0)\n"
        "dem = Dem.on(grid, np.random.default_rng(1).random(grid.shape))\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "try:\n    dem.write('a.tif')\nexcept InputError as error:\n    print(error)\n"
    )
    out = subprocess.run(
        [sys.executable, "-c", write], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert "a.tif could not be written" in out
    assert list(tmp_path.iterdir()) == []


@pytest.mark.reliability
def test_a_forbidden_place_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.toml").write_text(IDEAL_MISSION)
    assert "could not be written" in said(run("/proc/firnline"))
