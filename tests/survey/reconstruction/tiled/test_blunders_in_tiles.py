"""Maps in tiles leave gross blunders out and name them."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem
from tests.survey.reconstruction.tiled.conftest import strip_points, write_laz


@pytest.mark.parametrize("n_copies", [1, 4])
def test_a_map_in_tiles_leaves_a_blunder_out_and_names_it(n_copies, tmp_path):
    """Also where cells hold many points, in which case only cells with a large range are tested."""
    parts = [strip_points(1 + k, 0.0, 60.0, 0.0) for k in range(n_copies)]
    xyz = np.vstack(parts)
    highest = xyz[:, 2].max()
    xyz[117, 2] += 400.0
    file = write_laz(tmp_path / "a.laz", xyz, np.full(len(xyz), 7))
    small = ["--set", "tiles.tile_cells=80", "--set", "tiles.halo_cells=40", "--set", "tiles.n_draws=8"]
    command = ["reconstruct", str(file), "--tiles", "--workers", "1", "-o", str(tmp_path / "map"), *small]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert (
        "left out           1 point stands alone in height and counts as a blunder: it is at" in result.output
    )
    facts = json.loads((tmp_path / "map" / "reconstruction.json").read_text())["diagnostics"]
    assert facts["blunders"][0]["n"] == 1
    assert facts["blunders"][0]["x_m"] == [pytest.approx(xyz[117, 0], abs=0.01)]
    assert np.nanmax(Dem.read(tmp_path / "map" / "dem.vrt").elevation) < highest + 1.0
