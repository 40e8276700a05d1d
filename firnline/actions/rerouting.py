"""Change the route of a rover around hazards in the points that it has seen."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

import survey
from firnline.actions.interface import Preview, WrittenResult, place_of, previewed_by, refuse_existing
from firnline.actions.requests import RerouteRequest
from planners.look_ahead import SAMPLE_M, LookAhead, LookAheadSettings, Returns
from planners.routes.detours import densified
from planners.routes.replanning import rest_of
from survey.core import FloatArray, InputError, replacing_folder
from survey.core.documents import write_json
from survey.reconstruction.seen_ground import RiseLimit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OWN_FILES = ("*.tif", "route.geojson", "reroute.*", "*.aux.xml")
"""Patterns of the files that a changed route consists of."""
_WAYS_IN_REACHES = 4.0
_LEAST_CERTAIN = 0.5
_NAMES_ITS_CRS = (".las", ".laz", ".gpkg", ".geojson", ".shp")


@dataclass(frozen=True)
class RerouteResult(WrittenResult):
    """Route that avoids what the points show, from the rover on.

    Parameters
    ----------
    request : RerouteRequest
        What was asked for.
    route : Route
        What is left of the route, with its detours as transits.
    probability : Dem
        Probability that a rover stands on ground beyond the limit.
    area : SurveyArea
        Ground that may be driven.
    n_points : int
        Points within reach.
    n_detours : int
        Changes of the route.
    skipped_m : float
        Length of swaths that are left out [m].
    planned_m : float
        Length of what was left of the route before [m].
    seen_share : float
        Share of the changed route within reach whose ground was seen.
    """

    request: RerouteRequest
    route: survey.Route
    probability: survey.Dem
    area: survey.SurveyArea
    n_points: int
    n_detours: int
    skipped_m: float
    planned_m: float
    seen_share: float

    def _write_files(self) -> None:
        """Write route, probability, picture and facts into a folder."""
        with replacing_folder(self.request.out, own=OWN_FILES) as draft:
            self.route.write(draft / "route.geojson")
            self.probability.write(draft / "probability.tif", "probability")
            write_json(draft / "reroute.json", self.facts())
            self.request.write_pictures(draft, self._pictures)

    def _pictures(self) -> "Mapping[str, Figure]":
        from survey.figures.maps import probability_plot

        title = f"Ground beyond {self.request.max_slope_deg:g}°"
        # Detours are drawn as lines too.
        drawn = replace(self.route, legs=tuple(replace(leg, kind="swath") for leg in self.route.legs))
        return {"reroute": probability_plot(self.probability, title, area=self.area, route=drawn)}

    def facts(self) -> dict[str, Any]:
        """Return numbers of points and changes, lengths, and the share of steep ground."""
        shown = self.probability.elevation
        known = shown[np.isfinite(shown)]
        return {
            "n_points": self.n_points,
            "steep_share": float((known > self.request.accepted).mean()) if len(known) else 0.0,
            "seen_share_of_route": self.seen_share,
            "n_detours": self.n_detours,
            "planned_m": self.planned_m,
            "length_m": self.route.length_m,
            "skipped_m": self.skipped_m,
            "max_slope_deg": self.request.max_slope_deg,
            "base_m": self.request.base_m,
        }

    def lines(self) -> list[str]:
        """Return points, steep ground, changes, and the place of the route."""
        facts = self.facts()
        changed = (
            f"{self.n_detours} detours, {self.skipped_m:.0f} m of swaths left out"
            if self.n_detours
            else "nothing is in the way"
        )
        return [
            f"{self.n_points} points within {self.request.reach_m:g} m of the rover: {100 * facts['steep_share']:.1f} % of the seen ground is "
            f"beyond {self.request.max_slope_deg:g}° over {self.request.base_m:g} m with more than {100 * self.request.accepted:g} %",
            f"route: {changed}; {self.planned_m:.0f} m before, {self.route.length_m:.0f} m now",
            f"seen: the ground of {100 * self.seen_share:.0f} % of the route within reach; what was not seen counts as free",
            f"route: {self.request.out}/route.geojson",
        ]


def preview_reroute(request: RerouteRequest) -> Preview:
    """Read route and points, and return their numbers."""
    route, points, at, _ = _inputs(request)
    return Preview.of([request.out], {"legs": len(route.legs), "points": len(points), "rover": at.tolist()})


@previewed_by(preview_reroute)
def reroute(request: RerouteRequest) -> RerouteResult:
    """Change the route of a rover around hazards in the points that it has seen.

    Parameters
    ----------
    request : RerouteRequest
        Route, points, place of the rover, and its limits.

    Returns
    -------
    RerouteResult
        The changed route; `RerouteResult.write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    ConfigError
        A place that is no place.
    """
    route, points, at, area = _inputs(request)
    settings = LookAheadSettings(
        limit=RiseLimit(request.max_slope_deg, request.base_m),
        accepted=request.accepted,
        clearance_m=request.clearance_m,
        horizon_m=2.0 * request.reach_m,
        nearest_m=0.0,
        farthest_m=np.inf,  # points of a file come from several places
        window_m=2.0 * request.reach_m,
    )
    rest = rest_of(route, at)
    rover = LookAhead(rest, area, settings)
    near = np.abs(points.xyz[:, :2] - at).max(axis=1) <= request.reach_m
    if not near.any():
        raise InputError(
            f"{request.points}: none of {len(points)} points is within {request.reach_m:g} m of the rover at {at[0]:.1f}, {at[1]:.1f}; check "
            "--at and the CRS, or give a larger --reach."
        )
    limit_m, spread_m = settings.limit.rise_m, float(np.median(points.sigma_z[near]))
    if spread_m > _LEAST_CERTAIN * limit_m:
        raise InputError(
            f"{request.points}: heights that err by ± {spread_m:.3g} m are too uncertain for a limit of {request.max_slope_deg:g}°, a rise of "
            f"{limit_m:.3g} m over --base; give a smaller --sigma if they are better, or a longer --base."
        )
    seen = points.xyz[near]
    origins = None if points.origins is None else points.origins[near]
    rover.update(Returns(seen, origins, points.sigma_z[near]), at)
    try:
        probability = rover.probability_map()
    except InputError as error:
        raise InputError(f"{request.points}: {error}") from None
    if not rover.has_way:
        raise InputError(
            f"{request.points} shows no way from {at[0]:.1f}, {at[1]:.1f} to what is left of {request.route}; allow a steeper --max-slope or a "
            "smaller --clearance, give a larger --reach, or scan from another place."
        )
    changed = rover.remaining_route()
    within = densified(changed.path(), SAMPLE_M)
    within = within[np.abs(within - at).max(axis=1) <= request.reach_m]
    seen_share = float(np.isfinite(probability.at(within)).mean())
    return RerouteResult(
        request,
        changed,
        probability,
        area,
        int(near.sum()),
        rover.n_detours,
        rover.skipped_m,
        rest.length_m,
        seen_share,
    )


def _inputs(
    request: RerouteRequest,
) -> tuple[survey.Route, survey.SurfacePoints, FloatArray, survey.SurveyArea]:
    """Read route, points and area."""
    refuse_existing([request.out], force=request.force, inputs=[request.route, request.points], own=OWN_FILES)
    route = survey.Route.read(request.route)
    crs: Any = request.crs
    if crs is None and request.points.suffix.lower() not in _NAMES_ITS_CRS:
        crs = route.crs
    points = survey.SurfacePoints.read(request.points, crs=crs, sigma_m=request.sigma_m, ground=None)
    if points.crs != route.crs:
        raise InputError(
            f"{request.points} is in {points.crs.name} and {request.route} in {route.crs.name}; give both in one CRS."
        )
    at = route.path()[0] if request.at is None else place_of(request.at, "--at")
    # No way is sought farther away.
    near = shapely.Point(at).buffer(_WAYS_IN_REACHES * request.reach_m, cap_style="square")
    if request.area is None:
        return route, points, at, survey.SurveyArea(near, route.crs)
    area = survey.SurveyArea.read(request.area, crs=route.crs)
    if not area.polygon.intersects(near):
        raise InputError(
            f"{request.area} does not reach the rover at {at[0]:.1f}, {at[1]:.1f}; check --at and the CRS."
        )
    return route, points, at, survey.SurveyArea(area.polygon.intersection(near), area.crs, area.no_go)
