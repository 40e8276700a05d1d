"""Heights from images of a textured tilted plane that known cameras see, and their agreement with scans."""

from functools import cache

import numpy as np
import pytest

from survey import Dem, Grid, InputError, SurfacePoints, Trajectory
from survey.reconstruction.line_of_sight.scan_points import RegisteredReturns
from tests.vision_slam.tilted_plane import CAMERA, CRS, SOUTH, WEST, drive, height, tone
from vision_slam.ground_heights import ImageHeightsConfig, heights_from_images
from vision_slam.orthoimage import orthoimage
from vision_slam.scan_agreement import MOVED, POSE, SHADOW, HeightErrors, ScanStrip, contradictions

CONFIG = ImageHeightsConfig(
    nearest_m=5.0, farthest_m=20.0, spacing_m=2.0, baselines_m=(0.5, 1.0, 2.0), pixel_step=(16, 6)
)


@cache
def heights():
    return heights_from_images(drive().frames, CAMERA, drive().path, drive().low, CONFIG)


def test_heights_are_those_of_the_plane_although_the_map_is_too_low():
    error = heights().xyz[:, 2] - height(heights().xyz[:, :2])
    assert len(error) > 60
    assert np.median(np.abs(error)) < 0.03
    assert np.percentile(np.abs(error), 95) < 0.12
    assert heights().range_m.max() > 12.0


def test_a_path_without_images_is_refused():
    later = Trajectory(drive().path.time_s + 50.0, *list(vars(drive().path).values())[1:5])
    with pytest.raises(InputError, match="three or more are needed"):
        heights_from_images(drive().frames, CAMERA, later, drive().low, CONFIG)


def test_the_orthoimage_is_the_texture():
    grid = Grid((WEST + 10.0, SOUTH - 3.0, WEST + 13.0, SOUTH + 3.0), 0.1, CRS)
    true = Dem.on(drive().low.grid(), drive().low.elevation + 0.4)
    made = orthoimage(drive().frames, CAMERA, drive().path, true, grid, farthest_m=20.0)
    real = tone(drive().texture, grid.xy)
    seen = np.isfinite(made.bands[0].ravel())
    assert list(made.named) == ["grey"]
    assert made.seen_share > 0.9
    assert np.corrcoef(made.bands[0].ravel()[seen], real[seen])[0, 1] > 0.85


def scene(change=0.0, n=400):
    """Return heights on level ground with errors of 0.1 m, and returns of it; a part of the ground is higher in the images."""
    rng = np.random.default_rng(5)
    xy = rng.uniform(0.0, 30.0, (n, 2))
    z = 0.1 * rng.standard_normal(n) + change * (np.linalg.norm(xy - 15.0, axis=1) < 3.0)
    values = {
        "image": rng.integers(0, 9, n),
        "rival": np.full(n, 0.5),
        "brightness": np.ones(n),
        "time_s": np.ones(n),
    }
    own = np.tile(1e-4 * np.eye(3), (n, 1, 1))
    points = SurfacePoints(
        np.column_stack([xy, z]), covariance=own, origins=np.zeros((n, 3)), range_m=np.full(n, 15.0), values=values,
        crs=CRS, own_covariance=own, keyframe=np.zeros(n), heading_rad=np.zeros(n),
    )  # fmt: skip
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 30.0, 0.3), np.arange(0.0, 30.0, 0.3)))
    ground = np.column_stack([x, y, 0.02 * rng.standard_normal(len(x))])
    ones = np.ones(len(x))
    return points, RegisteredReturns(9.0 * ones, ground, 0.0 * ground, ones.astype(int))


def compared(points, returns):
    strip = ScanStrip.between(points, returns)
    errors = HeightErrors.learned(points, strip)
    return errors, *contradictions(points, strip, errors)


def test_errors_are_learned_beside_scans():
    errors, found, is_wrong = compared(*scene())
    sigma = errors.of(scene()[0])
    assert np.median(sigma) == pytest.approx(0.1, rel=0.25)
    assert 0.9 <= errors.coverage <= 1.0
    assert not any(one.reason == MOVED for one in found)
    assert is_wrong.sum() <= 2
    assert np.median(errors.added_to(scene()[0]).sigma_z) == pytest.approx(np.median(sigma))


def test_without_scans_errors_are_assumed_and_nothing_contradicts():
    points, returns = scene()
    errors, found, is_wrong = compared(points, returns._replace(xyz=returns.xyz + [500.0, 0.0, 0.0]))
    assert errors.n_learned == 0
    assert np.isnan(errors.coverage)
    assert not found
    assert not is_wrong.any()


def test_ground_that_moved_is_found_and_named():
    _, found, is_wrong = compared(*scene(change=0.8))
    first = found[0]
    assert first.reason == MOVED
    assert np.hypot(first.xy[0] - 15.0, first.xy[1] - 15.0) < 2.0
    assert first.difference_m == pytest.approx(0.8, abs=0.15)
    assert is_wrong[np.linalg.norm(scene()[0].xyz[:, :2] - 15.0, axis=1) < 2.5].all()


def test_dark_patches_are_shadows_and_one_image_is_a_pose_error():
    points, returns = scene(change=0.8)
    dark = SurfacePoints(
        **vars(points) | {"values": dict(points.values) | {"brightness": np.full(len(points), 0.4)}}
    )
    assert compared(dark, returns)[1][0].reason == SHADOW
    level, returns = scene()
    tilted = level.xyz + np.outer(level.values["image"] == 4, [0.0, 0.0, 0.7])
    _, found, _ = compared(SurfacePoints(**vars(level) | {"xyz": tilted}), returns)
    assert found
    assert {one.reason for one in found if one.n_images == 1} == {POSE}
