"""Estimate the surface of steep walls, undercuts and serac edges from LiDAR scans, with its standard deviation."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import survey
from firnline.actions.interface import (
    Preview,
    Progress,
    WrittenResult,
    no_progress,
    previewed_by,
    refuse_existing,
)
from firnline.actions.overhang_inputs import read_returns
from firnline.actions.requests import OverhangsRequest
from survey.core import picture_files, replacing_folder
from survey.core.crs import crs_text
from survey.core.documents import write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from survey.reconstruction import FreeSurface
    from survey.reconstruction.lattice.steep_places import SteepSection

OWN_FILES = ("surface.ply", "overhangs.json", *picture_files("overhangs"))
"""Names of the files that a surface consists of."""
# With more places a scanner moves, and its returns count as one scan.
_MOST_PLACES = 64


@dataclass(frozen=True)
class OverhangsResult(WrittenResult):
    """Surface that may overhang, and sections through its steepest places.

    Parameters
    ----------
    request : OverhangsRequest
        What was asked for.
    returns : SurfacePoints
        Returns with their errors.
    surface : FreeSurface
        Mesh with standard deviations.
    sections : list of SteepSection
        From the steepest place on.
    """

    request: OverhangsRequest
    returns: survey.SurfacePoints
    surface: "FreeSurface"
    sections: "list[SteepSection]"

    def _write_files(self) -> None:
        """Write surface, facts and picture into a folder."""
        with replacing_folder(self.request.out, own=OWN_FILES) as draft:
            self.surface.write(draft / "surface.ply")
            write_json(draft / "overhangs.json", self.facts())
            self.request.write_pictures(draft, self._pictures)

    def _pictures(self) -> "dict[str, Figure]":
        from survey.figures.overhangs import overhang_sections

        return {"overhangs": overhang_sections(self.surface, self.sections, self.returns)}

    def facts(self) -> dict[str, Any]:
        """Return numbers of returns and nodes, areas, standard deviations, learned scales, and the sections."""
        from survey.reconstruction.lattice.steep_places import OVERHANGING_DEG, STEEP_DEG, Facets

        surface, facets = self.surface, Facets.of(self.surface)
        seen, area_m2 = surface.is_supported, float(facets.area_m2.sum())
        stated: dict[str, Any] = {
            "crs": crs_text(self.returns.crs),
            "vertical_datum": self.returns.vertical_datum,
            "n_returns": len(self.returns),
            "n_places": self._n_places,
            "step_m": surface.step_m,
            "n_nodes": len(surface.nodes),
            "n_triangles": len(surface.triangles),
            "area_m2": area_m2,
            "supported_share": float(facets.area_m2[facets.is_supported].sum()) / area_m2,
            "steep_m2": facets.area_beyond(STEEP_DEG),
            "overhanging_m2": facets.area_beyond(OVERHANGING_DEG),
            "bending_m": surface.bending_m,
            "roughness_m": surface.roughness_m,
            "factor_near_returns": surface.factors[0],
            "factor_in_gaps": surface.factors[1],
            "sections": [
                {"start_m": one.start.tolist(), "end_m": one.end.tolist(), "steepness_deg": one.steepness_deg}
                for one in self.sections
            ],
        }
        for name, which in (("supported", seen), ("unsupported", ~seen)):
            if which.any():
                stated[f"sigma_{name}_m"] = float(np.median(surface.sigma_m[which]))
        return stated

    @property
    def _n_places(self) -> int:
        assert self.returns.origins is not None
        return len(np.unique(self.returns.origins, axis=0))

    def lines(self) -> list[str]:
        """Return returns, areas, standard deviations, sections, and the place of the surface."""
        facts = self.facts()
        sigmas = [
            f"{facts[name]:.3f} m {where}"
            for name, where in (
                ("sigma_supported_m", "where returns support it"),
                ("sigma_unsupported_m", "elsewhere"),
            )
            if name in facts
        ]
        sections = [
            f"section {letter}: {east:.1f} E, {north:.1f} N, {one.steepness_deg:.0f}° steep"
            for letter, one in zip("ABC", self.sections, strict=False)
            for east, north in [0.5 * (one.start + one.end)]
        ]
        return [
            f"returns: {facts['n_returns']} from {facts['n_places']} {'place' if facts['n_places'] == 1 else 'places'} of the scanner",
            f"surface: {facts['area_m2']:.1f} m², {100 * facts['supported_share']:.0f} % supported by returns; {facts['steep_m2']:.1f} m² of these are steeper "
            f"than 60°, {facts['overhanging_m2']:.1f} m² overhang",
            f"standard deviation along the normal (median): {', '.join(sigmas)}",
            *(sections or ["sections: none, no supported ground is steeper than 60°"]),
            f"surface: {self.request.out / 'surface.ply'}",
        ]

    @property
    def notes(self) -> list[str]:
        """The error that all returns of a scan share, where neither several scans show it nor the input states it."""
        assert self.returns.covariance is not None
        if (
            1 < self._n_places <= _MOST_PLACES
            or (self.returns.covariance != self.returns.own_covariance).any()
        ):
            return []
        return [
            "one scan, or a moving scanner, does not show the error of its place, and none is stated; give it with --scan-sigma."
        ]


def preview_overhangs(request: OverhangsRequest) -> Preview:
    """Read all scans, and return their numbers."""
    returns = _returns(request, no_progress)
    east, north, up = np.ptp(returns.xyz, axis=0)
    stated = {
        "returns": f"{len(returns)}, {returns.crs.name}",
        "extent": f"{east:.1f} × {north:.1f} × {up:.1f} m",
        "nodes": f"{request.step_m:g} m apart",
    }
    return Preview.of([request.out], stated)


@previewed_by(preview_overhangs)
def overhangs(request: OverhangsRequest, progress: Progress = no_progress) -> OverhangsResult:
    """Estimate the surface of steep walls, undercuts and serac edges from LiDAR scans, with its standard deviation.

    Parameters
    ----------
    request : OverhangsRequest
        Scans, their errors where they state none, and the distance between nodes.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    OverhangsResult
        Surface and sections; `OverhangsResult.write` writes them.

    Raises
    ------
    InputError
        Input that cannot be used, more returns or nodes than fit, or an output that exists.
    """
    returns = _returns(request, progress)
    from survey.reconstruction import free_lattice
    from survey.reconstruction.lattice.steep_places import steep_sections

    progress("surface", 0, 1)
    surface = free_lattice(returns, request.step_m)
    progress("surface", 1, 1)
    return OverhangsResult(request, returns, surface, steep_sections(surface))


def _returns(request: OverhangsRequest, progress: Progress) -> survey.SurfacePoints:
    """Check the output, and read the returns."""
    inputs = [*request.sources, request.trajectory, request.area]
    refuse_existing([request.out], force=request.force, inputs=inputs, own=OWN_FILES)
    return read_returns(request, progress)
