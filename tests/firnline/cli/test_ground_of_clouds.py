"""The record of a map states how the ground of a point cloud was found."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from firnline import actions
from firnline.actions.requests import ReconstructRequest


@pytest.mark.parametrize(
    ("ground", "n", "how"), [("auto", 1600, "ground filtered (SMRF"), ("all", 2000, None)]
)
def test_the_record_states_how_the_ground_was_found(tmp_path: Path, ground, n: int, how: str | None) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    header.add_crs(CRS("EPSG:32608"))
    las = laspy.LasData(header)
    x, y = np.random.default_rng(0).uniform(0.0, 20.0, (2, 2000))
    las.x, las.y, las.z = x, y, 100.0 + 0.1 * x + np.where(np.arange(2000) % 5 == 0, 6.0, 0.0)
    las.write(str(tmp_path / "a.las"))
    request = ReconstructRequest(
        sources=[tmp_path / "a.las"],
        sigma_m=0.1,
        method="tin",
        ground=ground,
        out=tmp_path / "map",
        no_pictures=True,
    )
    notes = actions.reconstruct(request).reconstruction.diagnostics.get("notes", [])
    if how is None:
        assert notes == []
    else:
        assert f"{n} of 2000 points are used" in notes[0]
        assert how in notes[0]
