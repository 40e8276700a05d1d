"""Files of tracked displacements."""

from pathlib import Path

import numpy as np
import pytest

from survey import InputError
from survey.core.crs import projected_crs
from survey.scoring.differencing.tracking import TrackedMotion, read_tracked, write_tracked

CRS = projected_crs("EPSG:32608", "the test")
XY = 500000.0 + 10.0 * np.arange(24.0).reshape(12, 2)


def tracked(first_east_m: float = 1.0, window_m: float = 30.0, *, is_flagged: bool = False) -> TrackedMotion:
    shift = np.column_stack([np.r_[first_east_m, np.ones(11)], np.full(12, 2.0)])
    outlier = np.r_[is_flagged, np.zeros(11, dtype=bool)]
    return TrackedMotion(XY, shift, np.tile(0.01 * np.eye(2), (12, 1, 1)), np.ones(12), outlier, window_m)


def test_displacements_come_back_as_they_were_written(tmp_path: Path) -> None:
    write_tracked(tmp_path / "v.gpkg", tracked(is_flagged=True), 5.0, CRS)
    found = read_tracked(tmp_path / "v.gpkg", CRS)
    np.testing.assert_allclose(found.shift_m, tracked().shift_m)
    np.testing.assert_allclose(found.covariance, tracked().covariance)
    assert (found.is_outlier.sum(), found.window_m) == (1, 30.0)


def test_displacements_that_are_not_finite_are_refused_unless_they_are_flagged(tmp_path: Path) -> None:
    write_tracked(tmp_path / "flagged.gpkg", tracked(np.nan, is_flagged=True), 5.0, CRS)
    assert len(read_tracked(tmp_path / "flagged.gpkg", CRS)) == 12
    write_tracked(tmp_path / "bad.gpkg", tracked(np.nan), 5.0, CRS)
    with pytest.raises(InputError, match="1 displacements that are NaN"):
        read_tracked(tmp_path / "bad.gpkg", CRS)
    write_tracked(tmp_path / "window.gpkg", tracked(window_m=np.nan), 5.0, CRS)
    with pytest.raises(InputError, match="window_m is NaN"):
        read_tracked(tmp_path / "window.gpkg", CRS)
