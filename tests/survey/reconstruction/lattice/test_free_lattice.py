"""Lattice with free nodes: a wall that overhangs, its standard deviation, shadows, distances, sections, files and refusals."""

from pathlib import Path

import numpy as np
import pytest

from survey import InputError, SurfacePoints
from survey.core import FloatArray
from survey.reconstruction import FreeSurface, beam_covariance, free_lattice

NOISE_M, ORIGIN = 0.01, (-6.0, 2.0, 1.5)


def face(n: int, rng: np.random.Generator, *, hidden: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Draw points of ground (z = 0) and of a face that leans over it from its foot at x = 0; none of heights between `hidden` [m]."""
    y, t = rng.uniform(0.0, 4.0, n), rng.uniform(-3.0, 3.0, n)
    xyz = np.column_stack([np.where(t < 0.0, t, -0.5 * t), y, np.maximum(t, 0.0)])
    return xyz[(xyz[:, 2] <= hidden[0]) | (xyz[:, 2] >= hidden[1])]


def points_of(xyz: FloatArray, rng: np.random.Generator) -> SurfacePoints:
    noisy = xyz + NOISE_M * rng.standard_normal(xyz.shape)
    origins = np.broadcast_to(np.array(ORIGIN), xyz.shape)
    return SurfacePoints(noisy, sigma_m=NOISE_M, origins=origins, crs="EPSG:32608")


@pytest.fixture(scope="module")
def surface() -> FreeSurface:
    rng = np.random.default_rng(4)
    return free_lattice(points_of(face(9000, rng), rng))


def test_ground_and_the_face_above_it_are_both_there(surface: FreeSurface) -> None:
    rng = np.random.default_rng(5)
    true = face(800, rng)
    away_from_rims = (np.abs(true[:, 2] - 1.4) < 1.2) | (
        (true[:, 2] == 0.0) & (true[:, 0] > -2.6) & (true[:, 0] < -0.3)
    )
    inside = away_from_rims & (np.abs(true[:, 1] - 2.0) < 1.6)
    found = surface.distances(true[inside])
    assert np.sqrt(np.mean(found.distance_m**2)) < 0.01
    assert np.mean(np.abs(found.distance_m) <= 1.96 * found.sigma_m) > 0.9
    assert found.is_supported.all()


def test_normals_face_the_scanner_and_distances_are_positive_there(surface: FreeSurface) -> None:
    below_the_face, inside_the_ice = [-1.0, 2.0, 1.0], [0.3, 2.0, 1.0]
    found = surface.distances([below_the_face, inside_the_ice])
    assert found.distance_m[0] == pytest.approx(0.5 / np.sqrt(1.25), abs=0.02)
    assert found.distance_m[1] == pytest.approx(-0.8 / np.sqrt(1.25), abs=0.02)
    on_face = (surface.nodes[:, 2] > 0.5) & (surface.nodes[:, 2] < 2.5) & surface.is_supported
    assert (surface.normals[on_face, 2] < 0.0).all()


def test_a_section_meets_the_same_place_twice(surface: FreeSurface) -> None:
    section = surface.section((-4.0, 2.0), (1.0, 2.0))
    at = section.along_m.mean(axis=1) - 4.0
    heights = section.z_m.mean(axis=1)[np.abs(at + 0.75) < 0.15]
    assert heights.min() == pytest.approx(0.0, abs=0.05)
    assert heights.max() == pytest.approx(1.5, abs=0.35)
    assert (section.sigma_m > 0.0).all()
    assert np.linalg.norm(section.normals, axis=1).max() <= 1.0 + 1e-9


def test_what_is_hidden_is_unsupported_and_less_certain() -> None:
    rng = np.random.default_rng(6)
    found = free_lattice(points_of(face(9000, rng, hidden=(0.8, 1.9)), rng))
    middle = found.distances([[-0.5 * 1.35, 2.0, 1.35]])
    seen = found.distances([[-0.5 * 2.5, 2.0, 2.5]])
    assert not middle.is_supported[0]
    assert seen.is_supported[0]
    assert middle.sigma_m[0] > 2.0 * seen.sigma_m[0]
    assert abs(middle.distance_m[0]) < 3.0 * middle.sigma_m[0]


def test_moving_all_points_moves_the_surface_alone(surface: FreeSurface) -> None:
    rng = np.random.default_rng(4)
    points = points_of(face(9000, rng), rng)
    shift = np.array([500_000.0, 6_700_000.0, 800.0])
    moved = free_lattice(
        SurfacePoints(points.xyz + shift, sigma_m=NOISE_M, origins=points.origins + shift, crs="EPSG:32608")
    )
    there = surface.is_supported  # elsewhere rounding decides between equal facets
    assert np.abs(moved.nodes - shift - surface.nodes)[there].max() < 2e-3
    assert np.median(np.abs(moved.sigma_m - surface.sigma_m)[there]) < 1e-4


def test_more_noise_is_stated_as_more_noise(surface: FreeSurface) -> None:
    rng = np.random.default_rng(4)
    true = face(9000, rng)
    noisy = true + 0.05 * rng.standard_normal(true.shape)
    origins = np.broadcast_to(np.array(ORIGIN), true.shape)
    covariance = np.broadcast_to(0.05**2 * np.eye(3), (len(true), 3, 3))
    found = free_lattice(SurfacePoints(noisy, covariance, origins=origins, crs="EPSG:32608"))
    assert np.median(found.sigma_m[found.is_supported]) > 1.5 * np.median(
        surface.sigma_m[surface.is_supported]
    )


def test_covariance_is_of_the_normal_alone(surface: FreeSurface) -> None:
    along = np.einsum("ni,nij,nj->n", surface.normals, surface.covariance, surface.normals)
    assert np.allclose(along, surface.sigma_m**2)
    assert np.allclose(np.trace(surface.covariance, axis1=1, axis2=2), surface.sigma_m**2)


def test_errors_of_a_beam_lie_along_and_across_the_ray() -> None:
    covariance = beam_covariance([[3.0, 4.0, 0.0]], [[0.0, 0.0, 0.0]], 0.02, 0.1)[0]
    unit = np.array([0.6, 0.8, 0.0])
    assert unit @ covariance @ unit == pytest.approx(0.02**2)
    assert covariance[2, 2] == pytest.approx((5.0 * np.radians(0.1)) ** 2)


def test_the_file_is_ply_with_all_nodes(surface: FreeSurface, tmp_path: Path) -> None:
    surface.write(tmp_path / "wall.ply")
    content = (tmp_path / "wall.ply").read_bytes()
    header, body = content.split(b"end_header\n", 1)
    assert f"element vertex {len(surface.nodes)}".encode() in header
    assert b"property float sigma" in header
    assert np.allclose(np.frombuffer(body[:24], "<f8"), surface.nodes[0])
    assert len(body) == 41 * len(surface.nodes) + 13 * len(surface.triangles)


def test_what_cannot_be_used_is_refused(surface: FreeSurface) -> None:
    rng = np.random.default_rng(7)
    points = points_of(face(300, rng), rng)
    without = SurfacePoints(points.xyz, sigma_m=NOISE_M, crs="EPSG:32608")
    with pytest.raises(InputError, match="do not state where the scanner stood"):
        free_lattice(without)
    with pytest.raises(InputError, match="give a step above 0"):
        free_lattice(points, step_m=0.0)
    with pytest.raises(InputError, match="give a larger step"):
        free_lattice(points, step_m=0.001)
    with pytest.raises(InputError, match="too few for a surface"):
        free_lattice(points.select(np.arange(5)))
    at_scanner = SurfacePoints(points.xyz, sigma_m=NOISE_M, origins=points.xyz, crs="EPSG:32608")
    with pytest.raises(InputError, match="lie where the scanner stood"):
        free_lattice(at_scanner)
    with pytest.raises(InputError, match="starts where it ends"):
        surface.section((0.0, 0.0), (0.0, 0.0))
