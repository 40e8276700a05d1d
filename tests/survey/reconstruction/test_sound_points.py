"""Every map leaves gross blunders out and names them, whoever asks for it; feet and far places are refused."""

import numpy as np
import pytest

from survey import Grid, InputError, SurfacePoints, SurveyArea
from survey.reconstruction.mapping import map_landmarks, map_scans, reconstruct
from survey.reconstruction.method import ScanSettings
from survey.reconstruction.registry import METHODS, ReconstructionConfig

CRS = "EPSG:32608"
GRID = Grid.over((5.0, 5.0, 95.0, 95.0), 5.0, CRS)


def heights(n: int = 300) -> np.ndarray:
    """Return points of a gentle hill near 1,000 m, the 18th of them 4,000 m too high."""
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.0, 100.0, (n, 2))
    z = 1000.0 + 2.0 * np.sin(xy[:, 0] / 30.0) + 0.02 * rng.standard_normal(n)
    z[17] += 4000.0
    return np.column_stack([xy, z])


def points(array: np.ndarray) -> SurfacePoints:
    return SurfacePoints(array, sigma_m=0.05, crs=CRS)


@pytest.mark.parametrize("method", ["gp", "dense", "tin", "field"])
def test_a_call_leaves_a_blunder_out_and_names_it(method):
    result = reconstruct(points(heights()), GRID, method=method)
    assert np.nanmax(result.mean.elevation) < 1003.0
    (found,) = result.diagnostics["blunders"]
    assert found["n"] == 1
    assert found["rows"] == [17]
    assert "1 point stands alone in height and counts as a blunder: it is point 18" in found["sentence"]


def test_missions_and_studies_leave_a_blunder_out():
    mapped = map_landmarks(points(heights()), GRID, ReconstructionConfig())
    assert np.nanmax(mapped.reconstruction.mean.elevation) < 1003.0
    assert mapped.n_points == 299
    assert mapped.reconstruction.diagnostics["blunders"][0]["n"] == 1


@pytest.mark.parametrize("method", ["field", "emap", "carving"])
def test_a_map_from_scans_leaves_a_blunder_out(method):
    scan = SurfacePoints(
        heights(), sigma_m=0.05, crs=CRS, origins=np.tile([50.0, 50.0, 1030.0], (len(heights()), 1))
    )
    made = map_scans([scan, scan], METHODS[method], ScanSettings(5.0), grid=GRID)
    assert np.nanmax(made.reconstruction.mean.elevation) < 1010.0
    assert [found["scan"] for found in made.reconstruction.diagnostics["blunders"]] == [1, 2]


def test_points_without_blunders_have_no_entry():
    sound = np.delete(heights(), 17, axis=0)
    assert "blunders" not in reconstruct(points(sound), GRID, method="tin").diagnostics


def test_a_far_place_is_refused_where_no_area_is_given():
    far = np.vstack([np.delete(heights(), 17, axis=0), [9000.0, 9000.0, 1000.0]])
    with pytest.raises(InputError, match="1 of 300 points lies far from all others"):
        reconstruct(points(far), GRID, method="tin")
    area = SurveyArea.rectangle((5.0, 5.0, 95.0, 95.0), CRS)
    assert np.isfinite(reconstruct(points(far), GRID, method="tin", area=area).mean.elevation).any()


def test_feet_among_metres_are_refused():
    mixed = np.delete(heights(), 17, axis=0)
    mixed[200:, 2] /= 0.3048
    with pytest.raises(InputError, match="those are in feet"):
        reconstruct(points(mixed), GRID, method="tin")
