"""One rule decides how landmarks are mapped."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.path_error import PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.mapping import choose_method, map_landmarks
from survey.reconstruction.registry import ReconstructionConfig

CRS = "EPSG:32608"
GRID = Grid((0.0, 0.0, 40.0, 40.0), 4.0, CRS)
KNOWN = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=15.0)


def landmarks(n: int = 60) -> SurfacePoints:
    rng = np.random.default_rng(2)
    xyz = np.column_stack([rng.uniform(0.0, 40.0, (n, 2)), rng.normal(0.0, 0.1, n)])
    own = np.tile(np.diag([1e-6, 1e-6, 0.01]), (n, 1, 1))
    return SurfacePoints(
        xyz,
        covariance=own + np.eye(3),
        origins=xyz + [0.0, 5.0, 1.0],
        crs=CRS,
        own_covariance=own,
        keyframe=rng.uniform(0.0, 1.0, n),
        heading_rad=np.zeros(n),
    )


def path() -> PathError:
    return PathError(np.array([0.0, 9.0]), sparse.identity(12, format="csr"), 6)


@pytest.mark.parametrize(
    ("settings", "has_path", "name"),
    [
        ({}, True, "joint"),
        ({}, False, "gp"),
        ({"landmark_errors": "inflated"}, True, "gp"),
        ({"method": "tin"}, True, "tin"),
        ({"method": "joint"}, False, "joint"),
    ],
)
def test_gp_becomes_joint_where_points_share_the_errors_of_their_path(
    settings: dict[str, object], has_path: bool, name: str
) -> None:
    config = ReconstructionConfig(**settings)  # type: ignore[arg-type]
    shared = path() if has_path else None
    assert choose_method(config.method, shared, config.landmark_errors).name == name


def test_independent_landmarks_count_by_their_own_errors_alone() -> None:
    config = ReconstructionConfig(gp=KNOWN, landmark_errors="independent")
    own = replace(landmarks(), covariance=landmarks().own_covariance)
    mapped = map_landmarks(landmarks(), GRID, config, path=path()).reconstruction
    expected = reconstruct(own, GRID, config=KNOWN)
    np.testing.assert_array_equal(mapped.std.elevation, expected.std.elevation)


def test_points_beyond_the_prior_are_left_out_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    prior = Dem.on(Grid((-10.0, -10.0, 50.0, 50.0), 10.0, CRS), np.zeros((7, 7)))
    points = landmarks()
    far = replace(
        points, xyz=np.where(np.arange(60)[:, None] < 3, points.xyz + [900.0, 0.0, 0.0], points.xyz)
    )
    with caplog.at_level(logging.WARNING):
        mapped = map_landmarks(
            far, GRID, ReconstructionConfig(gp=KNOWN, landmark_errors="inflated"), prior=prior
        )
    assert mapped.n_points == 57
    assert "3 of 60 landmarks lie beyond the prior" in caplog.text
    away = replace(points, xyz=points.xyz + [900.0, 0.0, 0.0])
    with pytest.raises(InputError, match="none of the 60 points lies on the prior"):
        map_landmarks(away, GRID, ReconstructionConfig(landmark_errors="inflated"), prior=prior)
