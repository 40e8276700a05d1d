"""Steepest places of a surface that may overhang, and vertical sections through them.

The steepness of a facet is the angle of its normal from the vertical: 0° on level ground, 90° on a wall, more below an overhang.
The steepest places are those cells of the plan, eight steps wide, whose facets have the largest sum of area times
:math:`1 - n_z`: long slopes count little, walls their area, and overhangs up to twice theirs.
"""

from typing import NamedTuple

import numpy as np

from survey.core import BoolArray, FloatArray
from survey.reconstruction.lattice.free_surface import FreeSurface, VerticalSection, facet_normals
from survey.reconstruction.lattice.surface_net import cell_numbers

STEEP_DEG, OVERHANGING_DEG = 60.0, 90.0
"""Steepness of walls and of overhangs [deg]."""
MOST_SECTIONS = 3
_CELL_IN_STEPS, _HALF_IN_STEPS, _APART_IN_CELLS = 8.0, 24.0, 1.5
_STEEPEST_SHARE = 0.75


class Facets(NamedTuple):
    """Places of the facets of a surface (M, 3) [m], unit normals (M, 3), areas (M,) [m²], and whether points support them (M,)."""

    places: FloatArray
    normals: FloatArray
    area_m2: FloatArray
    is_supported: BoolArray

    @classmethod
    def of(cls, surface: FreeSurface) -> "Facets":
        """Return the facets of a surface."""
        corners = surface.nodes[surface.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return cls(
            corners.mean(axis=1),
            facet_normals(surface.nodes, surface.triangles),
            0.5 * np.linalg.norm(across, axis=1),
            np.asarray(surface.is_supported[surface.triangles].all(axis=1)),
        )

    def select(self, which: BoolArray) -> "Facets":
        """Return some of the facets, by a mask (M,)."""
        return Facets(self.places[which], self.normals[which], self.area_m2[which], self.is_supported[which])

    @property
    def steepness_deg(self) -> FloatArray:
        """Angles of the normals from the vertical (M,) [deg]."""
        angle: FloatArray = np.degrees(np.arccos(np.clip(self.normals[:, 2], -1.0, 1.0)))
        return angle

    def area_beyond(self, steepness_deg: float) -> float:
        """Return the area of supported facets that are steeper [m²]."""
        return float(self.area_m2[self.is_supported & (self.steepness_deg > steepness_deg)].sum())


class SteepSection(NamedTuple):
    """Vertical section through a steep place.

    `start`, `end` (2,): easting and northing of both ends [m]; the surface is open towards the start. `steepness_deg`: steepness that a
    quarter of the facets in the cell exceed [deg]. `lines`: lines in which the surface meets the plane.
    """

    start: FloatArray
    end: FloatArray
    steepness_deg: float
    lines: VerticalSection

    def beside(self, xyz: FloatArray, within_m: float) -> FloatArray:
        """Return distances along the section and heights (K, 2) [m] of the points (P, 3) that lie within a distance of its plane."""
        length = float(np.hypot(*(self.end - self.start)))
        along = (self.end - self.start) / length
        offset = xyz[:, :2] - self.start
        at = offset @ along
        near = (np.abs(offset @ [-along[1], along[0]]) <= within_m) & (at >= 0.0) & (at <= length)
        return np.column_stack([at[near], xyz[near, 2]])


def steep_sections(surface: FreeSurface, most: int = MOST_SECTIONS) -> list[SteepSection]:
    """Cut a surface by vertical planes through its steepest places, along the mean direction of the normals there.

    Parameters
    ----------
    surface : FreeSurface
        Surface with standard deviations.
    most : int
        Greatest number of sections.

    Returns
    -------
    list of SteepSection
        From the steepest place on, each through another cell, one and a half cells or more from the others; none where no supported facet is steeper
        than 60°. Ends lie 24 steps from the place.

    Examples
    --------
    >>> x, z = np.meshgrid([0.0, 1.0], [0.0, 1.0])
    >>> wall = np.column_stack([0.2 * z.ravel(), x.ravel(), z.ravel()])  # leans back by 11°
    >>> ones = np.ones(4)
    >>> surface = FreeSurface(wall, np.array([[0, 2, 1], [1, 2, 3]]), wall, ones, ones > 0.0, 0.5, 0.1, 0.1, (1.0, 1.0))
    >>> round(steep_sections(surface)[0].steepness_deg)
    79
    """
    facets = Facets.of(surface)
    facets = facets.select(facets.is_supported & (facets.steepness_deg > STEEP_DEG))
    cell_m = _CELL_IN_STEPS * surface.step_m
    sections: list[SteepSection] = []
    while len(facets.places) and len(sections) < most:
        cell = cell_numbers(facets.places * [1.0, 1.0, 0.0], cell_m)
        score = np.bincount(cell, facets.area_m2 * (1.0 - facets.normals[:, 2]))
        section = _through(surface, facets.select(cell == np.argmax(score)))
        sections.append(section)
        middle = 0.5 * (section.start + section.end)
        away = np.abs(facets.places[:, :2] - middle).max(axis=1) > _APART_IN_CELLS * cell_m
        facets = facets.select(away)
    return sections


def _through(surface: FreeSurface, facets: Facets) -> SteepSection:
    """Return the section through the middle of facets, along their mean normal in the plan."""
    middle = np.average(facets.places[:, :2], axis=0, weights=facets.area_m2)
    along = facets.area_m2 @ facets.normals[:, :2]
    length = float(np.hypot(*along))
    along = along / length if length > 0.0 else np.array([1.0, 0.0])
    half = _HALF_IN_STEPS * surface.step_m * along
    steepness_deg = float(np.quantile(facets.steepness_deg, _STEEPEST_SHARE))
    start, end = middle + half, middle - half
    return SteepSection(start, end, steepness_deg, surface.section(start, end))
