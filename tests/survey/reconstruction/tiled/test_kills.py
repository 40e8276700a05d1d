"""Maps in tiles whose workers, command or scheduler are killed end with the same bytes."""

from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.whole_glacier.kills import (
    command_killed,
    dask_cluster,
    digest,
    free_address,
    scheduler_killed,
    workers_killed,
)
from benchmarks.whole_glacier.mapping import command, used_by

pytestmark = [pytest.mark.reliability, pytest.mark.timeout(3600)]  # every kill costs a start

SMALL = [
    f"--set=tiles.{key}" for key in ("tile_cells=80", "halo_cells=40", "n_draws=8", "withheld_share=0.05")
]


@pytest.fixture(scope="module")
def quiet(laz_files: list[Path], tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the digest of a map that nothing disturbed."""
    out = tmp_path_factory.mktemp("quiet") / "map"
    used_by(command(laz_files, out, "--workers", "1", *SMALL))
    return digest(out)


@pytest.mark.long
@pytest.mark.parametrize("n", [1, pytest.param(10, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("kill", [pytest.param(workers_killed, marks=pytest.mark.exhaustive), command_killed])
def test_kills_change_no_byte(
    kill: Callable[[list[str], Path, int], int], n: int, laz_files: list[Path], quiet: str, tmp_path: Path
) -> None:
    out = tmp_path / "map"
    assert kill(command(laz_files, out, "--workers", "2", *SMALL), out, n) == n
    assert digest(out) == quiet


@pytest.mark.exhaustive
def test_after_a_killed_scheduler_the_same_command_goes_on_to_the_same_bytes(
    laz_files: list[Path], quiet: str, tmp_path: Path
) -> None:
    pytest.importorskip("distributed")
    out, address = tmp_path / "map", free_address()
    arguments = command(laz_files, out, "--scheduler", address, *SMALL)
    assert scheduler_killed(arguments, out, address, 2) == 3
    with dask_cluster(address, 2):
        used_by(arguments)
    assert digest(out) == quiet
