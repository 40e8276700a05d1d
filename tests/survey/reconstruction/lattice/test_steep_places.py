"""Steepest places: areas of walls and overhangs, and sections through them in the direction of their normals."""

import numpy as np
import pytest

from survey.core import FloatArray
from survey.reconstruction import FreeSurface
from survey.reconstruction.lattice.steep_places import Facets, steep_sections

STEP_M, LENGTH_M = 0.5, 40.0


def sheet(profile: FloatArray, *, seen_from_m: float = 0.0) -> FreeSurface:
    """Sweep a profile (K, 2) of x and z [m] over 40 m to the north; nodes lower than a height have no points."""
    y = np.arange(0.0, LENGTH_M + 0.1, STEP_M)
    nodes = np.concatenate([np.column_stack([np.full_like(y, x), y, np.full_like(y, z)]) for x, z in profile])
    number = np.arange(len(nodes)).reshape(len(profile), len(y))
    a, b, c, d = (
        part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    seen = nodes[:, 2] >= seen_from_m
    return FreeSurface(
        nodes, triangles, np.zeros_like(nodes), np.full(len(nodes), 0.02), seen, STEP_M, 0.1, 0.01, (1.0, 1.0)
    )


def leaning_face() -> FloatArray:
    """Return a profile of level ground and of a face that leans over it by 45°, 2 m high."""
    return np.array([[-6.0, 0.0], [-3.0, 0.0], [0.0, 0.0], [-1.0, 1.0], [-2.0, 2.0], [3.0, 2.0]])


def test_areas_of_walls_and_overhangs_are_those_of_the_profile() -> None:
    facets = Facets.of(sheet(leaning_face()))
    assert facets.area_m2.sum() == pytest.approx(LENGTH_M * (6.0 + 2.0 * np.sqrt(2.0) + 5.0))
    assert facets.area_beyond(90.0) == pytest.approx(LENGTH_M * 2.0 * np.sqrt(2.0))
    assert facets.area_beyond(136.0) == 0.0


def test_what_no_point_supports_does_not_count() -> None:
    assert Facets.of(sheet(leaning_face(), seen_from_m=0.5)).area_beyond(90.0) == pytest.approx(
        LENGTH_M * np.sqrt(2.0)
    )


def test_sections_cross_the_overhang_from_its_open_side_and_lie_apart() -> None:
    sections = steep_sections(sheet(leaning_face()))
    assert len(sections) == 3
    for one in sections:
        assert one.steepness_deg == pytest.approx(135.0)
        assert one.start[0] < -1.0 < one.end[0]
        assert one.start[1] == pytest.approx(one.end[1])
        assert np.hypot(*(one.end - one.start)) == pytest.approx(48.0 * STEP_M)
        assert one.lines.z_m.max() == pytest.approx(2.0)
    assert np.diff(sorted(one.start[1] for one in sections)).min() >= 6.0


def test_gentle_ground_has_no_section() -> None:
    assert steep_sections(sheet(np.array([[0.0, 0.0], [4.0, 1.0], [8.0, 3.0]]))) == []


def test_points_beside_a_section_are_those_within_a_distance_of_its_plane() -> None:
    one = steep_sections(sheet(leaning_face()), most=1)[0]
    middle = np.append(0.5 * (one.start + one.end), 1.0)
    places = middle + np.array([[1.0, 0.1, 0.0], [1.0, 0.3, 0.0], [40.0, 0.0, 0.0]])
    assert one.beside(places, 0.2) == pytest.approx(np.array([[13.0, 1.0]]))
