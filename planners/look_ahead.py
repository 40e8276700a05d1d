"""Change a route while it is driven, around hazards that the rover's scanner sees ahead.

After every scan `LookAhead.update` finds the ground that is too steep for the rover (`survey.reconstruction.seen_ground`). Where the route
ahead crosses it, the route is changed before the rover is there (`planners.routes.detours`). Ground near the rover that no return shows
is not driven on: it may be a crevasse. What was found is remembered, and is looked at again from nearby.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt
from shapely import LineString

from planners.routes.detours import BEFORE_M, CostGrid, densified
from survey import Dem, Grid, InputError, Leg, Route, SurveyArea
from survey.core import BoolArray, CapacityError, FloatArray
from survey.reconstruction.line_of_sight.returns import ghosts
from survey.reconstruction.nodes import NodeWindow
from survey.reconstruction.seen_ground import RiseLimit, SeenGround

SAMPLE_M = 0.25
"""Distance between samples of the path, and between the nodes of the ground [m]."""
# The window moves after so much travel; probabilities count as hazards from here on far away, and cost so many metres a metre.
_MOVES_M, _LIKELY, _PER_PROBABILITY, _PER_UNSEEN = 5.0, 0.5, 10.0, 0.3
# What is seen within so many times `near_m` is remembered.
_NEARBY = 1.5
# A path is changed where it comes this near to a hazard, as a share of the clearance that a new one keeps.
_TRIGGER = 0.6
# Waypoints are left out that are nearer to the straight way than this [m].
_BENT_M = 0.02
# Nodes of the area: 4 km².
_MOST_NODES = 64_000_000
# Scans at rest before a path without a way is given up.
_MOST_AT_REST = 8
# Samples of the way that the rover may go back.
_N_RECENT = 1000
# Sides of the ground on which a way is sought, in windows.
_WIDER = (1, 4)


class Returns(NamedTuple):
    """Returns of scans in the world.

    `xyz` (N, 3): places [m]. `origins` (N, 3): places of the scanner [m]; without them no line of sight bounds the ground. `sigma_m` (N,):
    standard deviations of the heights [m].
    """

    xyz: FloatArray
    origins: FloatArray | None
    sigma_m: FloatArray

    def select(self, which: BoolArray) -> "Returns":
        """Return some of the returns."""
        origins = None if self.origins is None else self.origins[which]
        return Returns(self.xyz[which], origins, self.sigma_m[which])


@dataclass(frozen=True, kw_only=True)
class LookAheadSettings:
    """What a rover can stand, and how far ahead its path is kept free.

    Parameters
    ----------
    limit : RiseLimit
        Steepest ground.
    accepted : float
        Probability of ground beyond the limit from which it is avoided nearby.
    clearance_m : float
        Distance that a changed route keeps from such ground, for errors of position and steering [m].
    horizon_m : float
        Length of the path ahead that is kept free [m].
    near_m : float
        Ground within this distance that was not seen is avoided [m].
    brake_m : float
        Length of the path ahead that must be free; else the rover stops [m].
    nearest_m, farthest_m : float
        Returns from nearer to the scanner, which are blown snow, and from farther are left out [m].
    window_m : float
        Side of the ground that is kept about the rover [m].

    Notes
    -----
    A scanner at a height h sees into a gap from a distance of ``h / tan(slope)`` on, 3.2 m for 1.5 m and 25°: `near_m` must be larger, and the
    lowest beam must reach ground that is nearer.
    """

    limit: RiseLimit = field(default_factory=RiseLimit)
    accepted: float = 0.05
    clearance_m: float = 1.1
    horizon_m: float = 12.0
    near_m: float = 3.5
    brake_m: float = 0.75
    nearest_m: float = 2.4
    farthest_m: float = 16.0
    window_m: float = 40.0


class LookAhead:
    """Route of a rover that is changed while it is driven.

    Parameters
    ----------
    route : Route
        Planned route of one rover.
    area : SurveyArea
        Ground that may be driven.
    settings : LookAheadSettings
        Limits and distances.

    Attributes
    ----------
    path : (M, 2) ndarray
        What is left of the route, `SAMPLE_M` apart, from the rover on [m].
    on_swath : (M,) ndarray of bool
        Which samples are of planned swaths.
    n_stops, n_detours : int
        How often the rover had to stop for a change of the route, and changes in all.
    skipped_m : float
        Length of planned swaths that were left out [m].
    has_way : bool
        Whether a way along the path is known; without one the rover scans again at rest, and gives up what it cannot reach after 8 scans.

    Raises
    ------
    InputError
        A route of several rovers.
    CapacityError
        An area of more than 4 km².

    Notes
    -----
    The ground within `near_m` of the start counts as free where nothing is seen: somebody has put the rover there.
    """

    def __init__(self, route: Route, area: SurveyArea, settings: LookAheadSettings) -> None:
        if route.n_rovers > 1:
            raise InputError(f"the route is of {route.n_rovers} rovers; give the route of one.")
        parts = [densified(leg.xy, SAMPLE_M) for leg in route.legs]
        kinds = [np.full(len(part), leg.kind == "swath") for part, leg in zip(parts, route.legs, strict=True)]
        # Legs begin where the one before ends.
        self.path = np.vstack([parts[0][:1], *(part[1:] for part in parts)])
        self.on_swath = np.concatenate([kinds[0][:1], *(kind[1:] for kind in kinds)])
        self.n_stops = self.n_detours = self._n_scans_at_rest = 0
        self.skipped_m, self.has_way = 0.0, True
        self._route, self._settings, self._start = route, settings, self.path[0]
        self._driven: list[tuple[FloatArray, bool]] = []
        self._seen = SeenGround(NodeWindow.around(self._start, settings.window_m, SAMPLE_M))
        xmin, ymin, xmax, ymax = area.bounds
        margin = settings.window_m
        self._site = NodeWindow.over((xmin - margin, ymin - margin, xmax + margin, ymax + margin), SAMPLE_M)
        if (n_nodes := int(np.prod(self._site.shape))) > _MOST_NODES:
            raise CapacityError(
                f"the area has {n_nodes:,} nodes of {SAMPLE_M} m and {_MOST_NODES:,} can be remembered; give the part of it that is driven next."
            )
        shapely.prepare(area.free)
        self._allowed = shapely.contains_xy(area.free, self._site.xy).reshape(self._site.shape)
        self._steep = np.zeros(self._site.shape, dtype=bool)

    @property
    def is_done(self) -> bool:
        """Whether nothing of the path is left."""
        return len(self.path) < 2

    def update(self, returns: Returns, at: FloatArray) -> bool:
        """Add a scan, change the path where it is blocked, and return whether the rover stops for it.

        Parameters
        ----------
        returns : Returns
            Scan, placed by the estimated pose.
        at : (2,) ndarray
            Estimated place of the rover [m].

        Returns
        -------
        bool
            True where the ground just ahead was found blocked, or no way on is found yet: scan again before driving on.
        """
        if returns.origins is not None:
            range_m = np.linalg.norm(returns.xyz - returns.origins, axis=1)
            returns = returns.select(
                (range_m >= self._settings.nearest_m) & (range_m <= self._settings.farthest_m)
            )
        self._add(returns, at)
        ahead = self.path[: round(self._settings.horizon_m / SAMPLE_M)]
        blocked = self._costs(at, self._seen.window, _TRIGGER).blocked_samples(ahead)
        if len(blocked) == 0:
            return False
        self.has_way = self._change(at)
        stops = not self.has_way or bool(blocked[0] * SAMPLE_M <= self._settings.brake_m)
        self.n_stops += stops and self._n_scans_at_rest == 0
        self._n_scans_at_rest = self._n_scans_at_rest + 1 if stops else 0
        return stops and self._n_scans_at_rest <= _MOST_AT_REST

    def advance(self, distance_m: float) -> FloatArray:
        """Drive on along the path.

        Parameters
        ----------
        distance_m : float
            Distance to drive [m].

        Returns
        -------
        (K, 2) ndarray
            Samples from where the rover is to where it comes [m].
        """
        self._n_scans_at_rest = 0
        n = min(max(round(distance_m / SAMPLE_M), 1), len(self.path) - 1)
        driven, kinds = self.path[: n + 1], self.on_swath[1 : n + 1]
        self._driven += list(zip(driven[1:], kinds.tolist(), strict=True))
        self.path, self.on_swath = self.path[n:], self.on_swath[n:]
        return driven

    def driven_route(self) -> Route:
        """Return the route as it was driven; detours are transits.

        Returns
        -------
        Route
            From the start to where the rover is.
        """
        return self._as_route(
            np.vstack([self._start, *(place for place, _ in self._driven)]),
            np.array([kind for _, kind in self._driven]),
        )

    def remaining_route(self) -> Route:
        """Return what is left of the route; detours are transits.

        Returns
        -------
        Route
            From where the rover is.
        """
        return self._as_route(self.path, self.on_swath[1:])

    def probability_map(self) -> Dem:
        """Return the probability that a rover stands on ground beyond the limit, in the window about it.

        Returns
        -------
        Dem
            At least 0.5 where a gap may be, NaN where nothing was seen.

        Raises
        ------
        InputError
            Nothing was seen: returns are too sparse.
        """
        if not self._is_seen.any():
            raise InputError(
                f"no node of {SAMPLE_M} m holds three returns; give denser points, such as the scans of the last metres."
            )
        xmin, ymin, xmax, ymax = self._seen.window.bounds
        shown = np.where(
            self._is_seen,
            np.where(self._likely, np.maximum(self._probability, _LIKELY), self._probability),
            np.nan,
        )
        return Dem.on(Grid((xmin, ymin, xmax, ymax), SAMPLE_M, self._route.crs), shown[::-1])

    def _as_route(self, xy: FloatArray, kinds: BoolArray) -> Route:
        """Return samples (N, 2) as legs, swaths where the way to the next sample (N - 1,) is of one."""
        ends = [0, *(np.flatnonzero(kinds[1:] != kinds[:-1]) + 1).tolist(), len(kinds)]
        legs = [
            Leg(
                "swath" if kinds[first] else "transit",
                shapely.get_coordinates(LineString(xy[first : last + 1]).simplify(_BENT_M)),
            )
            for first, last in pairwise(ends)
        ]
        return Route(tuple(legs), self._route.crs, self._route.pattern, self._route.spacing_m)

    def _add(self, returns: Returns, at: FloatArray) -> None:
        """Add the returns that can be used, and remember the steep ground among them."""
        settings = self._settings
        middle = self._seen.window.xy.mean(axis=0)
        if np.abs(middle - at).max() > _MOVES_M:
            self._seen.move_to(NodeWindow.around(at, settings.window_m, SAMPLE_M))
        usable = returns.select(~ghosts(returns.xyz)) if len(returns.xyz) else returns
        self._seen.add(usable.xyz, usable.origins, usable.sigma_m)
        window = self._seen.window
        self._is_seen = self._seen.is_seen()
        self._probability = self._seen.steep_probability(settings.limit)
        near = _away_m(window, at) <= _NEARBY * settings.near_m
        self._likely = self._probability > np.where(near, settings.accepted, _LIKELY)
        self._likely |= self._seen.gaps(settings.limit, near)
        remembered = self._steep[window.within(self._site)]
        here = self._site.within(window)
        remembered[:] = np.where((self._is_seen & near)[here], self._likely[here], remembered)

    def _change(self, at: FloatArray) -> bool:
        """Lead the path around what blocks it, part after part, and return whether a way was found.

        A path without a way stays until the ground was scanned several times at rest; then it ends before what blocks it.
        """
        settings, done, kinds = self._settings, list[FloatArray](), []
        path, on_swath, skipped_m = self.path, self.on_swath, 0.0
        for wider in _WIDER:
            window = self._seen.window
            if wider > 1:
                window = NodeWindow.around(at, wider * settings.window_m, SAMPLE_M)
            grid = self._costs(at, window, 1.0)
            while len(blocked := grid.blocked_samples(path)):
                found = grid.detour(path, on_swath, SAMPLE_M)
                if found is None:
                    break
                way = densified(found.xy, SAMPLE_M)
                skipped_m += SAMPLE_M * float(on_swath[found.leaves : found.joins].sum())
                done += [path[: found.leaves], way[:-1]]
                kinds += [on_swath[: found.leaves], np.zeros(len(way) - 1, dtype=bool)]
                path, on_swath = path[found.joins :], on_swath[found.joins :]
            if len(blocked) == 0:
                break
        else:
            if self._n_scans_at_rest < _MOST_AT_REST:
                return False
            skipped_m += SAMPLE_M * float(on_swath[int(blocked[0]) :].sum())
            n = max(int(blocked[0]) - round(BEFORE_M / SAMPLE_M), 1)
            path, on_swath = path[:n], on_swath[:n]
        self.n_detours += 1
        self.skipped_m += skipped_m
        self.path, self.on_swath = np.vstack([*done, path]), np.concatenate([*kinds, on_swath])
        return True

    def _way_back(self, at: FloatArray, window: NodeWindow) -> BoolArray:
        """Return which nodes (H, W) of a window the rover came by, a node on either side included."""
        came = np.vstack([at, *(place for place, _ in self._driven[-_N_RECENT:])])
        column, row = np.rint(window.coordinates(came)).astype(np.int64).T
        within = (column >= 1) & (row >= 1) & (column < window.columns - 1) & (row < window.rows - 1)
        found = np.zeros(window.shape, dtype=bool)
        for south, east in np.ndindex(3, 3):
            found[row[within] + south - 1, column[within] + east - 1] = True
        return found

    def _costs(self, at: FloatArray, window: NodeWindow, share: float) -> CostGrid:
        """Return the costs of the ground in a window, by what was seen and what is remembered, with a share of the clearance."""
        settings, old = self._settings, self._seen.window
        seen, probability = window.carried(self._is_seen, old, False), window.carried(self._probability, old)
        away_m = _away_m(window, at)
        unknown = ~seen & (away_m < settings.near_m) & (_away_m(window, self._start) > settings.near_m)
        likely = window.carried(self._likely, old, False)
        hazard = window.carried(self._steep, self._site, False) | likely | unknown
        clear_m = _clear_m(hazard)
        blocked = clear_m <= share * settings.clearance_m
        # A rover that finds itself within the clearance may leave it, and may go back where it came from. What is seen now counts for more
        # than that, as the error of its place has changed since.
        blocked &= (away_m > settings.clearance_m + SAMPLE_M) | hazard
        blocked &= ~(self._way_back(at, window) & (_clear_m(likely) > 0.5 * settings.clearance_m))
        blocked |= ~window.carried(self._allowed, self._site, False)
        cost = (
            1.0
            + (clear_m <= 2.0 * settings.clearance_m)
            + _PER_UNSEEN * ~seen
            + _PER_PROBABILITY * probability
        )
        return CostGrid(window, np.where(blocked, np.inf, cost))


def _clear_m(hazard: BoolArray) -> FloatArray:
    """Return the distance of every node (H, W) from the next hazard [m]."""
    if not hazard.any():
        return np.full(hazard.shape, np.inf)
    clear: FloatArray = distance_transform_edt(~hazard) * SAMPLE_M
    return clear


def _away_m(window: NodeWindow, at: FloatArray) -> FloatArray:
    """Return the distances (H, W) of the nodes of a window from a place [m]."""
    away: FloatArray = np.hypot(*(window.xy - at).T).reshape(window.shape)
    return away
