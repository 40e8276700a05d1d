"""Routes of parallel swaths: reference lines, tie lines, and the legs that join them.

`swath_route` lays swaths of any shape along reference lines, adds tie lines across them, and joins them. On a
rectangle that the swaths run along, one rover that pivots sweeps them back and forth. Otherwise the lines are cut to
the free ground with room for turns at their ends. `join_swaths` orders swaths and joins them by the shortest transits
found, or shares them among the rovers of a fleet. Swaths back and forth load no compiled
loops.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely

from planners.config import SwathConfig
from planners.routes.fleet import share
from planners.routes.rover import Crew, Rover, homes_of
from planners.routes.shortest_paths import FreeGround, shared_ground
from planners.routes.turns import headland_m
from planners.steering import SteeredConfig
from planners.swaths.decomposition import clip_lines, swaths_on, without_headland
from planners.swaths.heading import heading_by, undivided_heading
from planners.swaths.reference_lines import (
    ReferenceLines,
    Swath,
    axes_of,
    lines_over,
    reference_lines,
    shortened,
    shortest_m,
)
from planners.swaths.worth_driving import APART_M, worth_driving
from survey import Leg, Route, SurveyArea
from survey.core import FloatArray

SwathShape = Callable[[list[FloatArray], float], list[Swath]]
"""Returns what is driven along axes, each (2, 2) [m], that are a spacing [m] apart."""


def swath_route(area: SurveyArea, config: SwathConfig, crew: Crew, shape: SwathShape) -> Route:
    """Lay swaths of a shape along reference lines, add tie lines, and join them.

    On a rectangle that the swaths run along, one rover that pivots sweeps them back and forth; otherwise they are cut
    into cells and joined by `join_swaths`.
    """
    config = _with_heading(area, config, crew)
    lines = reference_lines(area, config, crew.rover.turn_m)

    def tied(laid: list[Swath]) -> list[Swath]:
        return laid + tie_lines(area, config, lines.heading_deg, laid[-1].xy[-1])

    swept = tied(shape(lines.back_and_forth, lines.spacing_m))
    legs = _back_and_forth(swept, area) if crew.is_unbound else None
    if legs is None:
        corner = None if config.start is None else lines.lines[0][0][0]
        least_m = shortest_m(config, lines.spacing_m, crew.rover.turn_m)
        # What is steered about a line needs ground along it.
        bends = crew.rover.turn_radius_m == 0.0 and not isinstance(config, SteeredConfig)
        laid = _laid_on(area, config, lines, crew.rover, shape)
        legs = join_swaths(tied(laid), area, crew, corner, shortest_m=least_m, bends=bends)
    return Route(legs, area.crs, config.pattern, lines.spacing_m)


def _with_heading(area: SurveyArea, config: SwathConfig, crew: Crew) -> SwathConfig:
    """Return the configuration with the heading that its rule gives."""
    if config.heading_deg is not None:
        return config
    ground = shared_ground(area.free)
    if config.heading_rule == "narrowest":
        heading_deg = undivided_heading(ground, config, crew.rover.turn_m)
    else:
        heading_deg = heading_by(config.heading_rule, ground, dem=crew.dem, spacing_m=config.spacing_m)
    return config.model_copy(update={"heading_deg": heading_deg})


def _back_and_forth(swaths: Sequence[Swath], area: SurveyArea) -> tuple[Leg, ...] | None:
    """Join swaths by straight transits in the given order; None where a metre would leave the free ground."""
    legs: list[Leg] = []
    here = area.starts[0] if len(area.starts) else swaths[0].xy[0]
    for swath in swaths:
        if np.hypot(*(swath.xy[0] - here)) > 0.0:
            legs.append(Leg("transit", np.array([here, swath.xy[0]])))
        legs.append(Leg("swath", swath.xy, axis=swath.axis))
        here = swath.xy[-1]
    shapely.prepare(area.free)
    stays = area.free.covers(shapely.multilinestrings([shapely.linestrings(leg.xy) for leg in legs]))
    return tuple(legs) if stays else None


def _laid_on(
    area: SurveyArea, config: SwathConfig, lines: ReferenceLines, rover: Rover, shape: SwathShape
) -> list[Swath]:
    """Lay swaths on ground of any shape, every metre proven to be on it, with room for turns at their ends.

    The swath of a pocket beside a line is a piece of this line: there are as many lines as were asked for.
    """
    ground, heading_deg, spacing_m = shared_ground(area.free), lines.heading_deg, lines.spacing_m
    room_m = headland_m(rover, spacing_m)
    laid, _ = lines_over(without_headland(ground, room_m), config, heading_deg, rover.turn_m)
    axes = swaths_on(ground, spacing_m, heading_deg, lines=laid, headland_m=room_m)
    inset_m = max(config.inset_share * spacing_m - room_m, 0.0)
    left = axes_of(heading_deg)[1]
    swaths = []
    for swath in shape([shortened(axis, inset_m) for axis in axes], spacing_m):
        move = min(((line[0] - swath.axis[0]) @ left for line in laid), key=abs)
        if abs(move) <= APART_M or (isinstance(config, SteeredConfig) and config.swaths is None):
            swaths.append(swath)
        elif not isinstance(config, SteeredConfig):
            swaths.append(Swath(swath.xy, swath.axis + move * left))
    return swaths


def join_swaths(
    swaths: Sequence[Swath],
    area: SurveyArea,
    crew: Crew,
    corner: FloatArray | None = None,
    *,
    shortest_m: float = 0.0,
    bends: bool = False,
) -> tuple[Leg, ...]:
    """Clip swaths to the free ground, order them and join them by the shortest transits found.

    Turning radii, several rovers, batteries and a place to finish are those of the crew. `corner` (2,): where the area
    has no start, the route begins at the end of a swath nearest to it [m]. `shortest_m`, `bends`: as in `worth_driving`.
    """
    from planners.routes.tours import connect

    ground = shared_ground(area.free)
    clipped = [
        Swath(xy, swath.axis) for swath in swaths for xy in clip_lines(ground, [swath.xy]) if len(xy) > 1
    ]
    kept = worth_driving(clipped, ground, shortest_m, bends=bends)
    homes = homes_of(area, crew)
    if homes is not None and crew.makes_round_trips:
        return _shared(kept, ground, homes, crew)
    start = homes[0] if homes is not None else _end_nearest(kept, corner)
    end = start if crew.fleet.return_to_start else crew.fleet.end_m
    axes = [swath.axis for swath in kept]
    return connect([swath.xy for swath in kept], ground, start=start, end=end, axes=axes, turning=crew.rover)


def _end_nearest(swaths: Sequence[Swath], corner: FloatArray | None) -> FloatArray | None:
    if corner is None:
        return None
    ends = np.vstack([swath.xy[[0, -1]] for swath in swaths])
    nearest: FloatArray = ends[np.argmin(np.hypot(*(ends - corner).T))]
    return nearest


def _shared(swaths: Sequence[Swath], ground: FreeGround, homes: FloatArray, crew: Crew) -> tuple[Leg, ...]:
    """Share the swaths of every part of the ground among the rovers that begin there; number those that drive."""
    part_of_swath = ground.part_of([swath.xy[0] for swath in swaths])
    part_of_home = ground.part_of(homes)
    legs: list[Leg] = []
    for part in np.unique(part_of_swath):
        mine = [swath for swath, p in zip(swaths, part_of_swath, strict=True) if p == part]
        legs_here = share(
            [swath.xy for swath in mine],
            ground,
            homes[part_of_home == part],
            mobility=crew.rover,
            dem=crew.dem,
            axes=[swath.axis for swath in mine],
            turning=crew.rover,
        )
        n_before = len({leg.rover for leg in legs})
        number = {r: n_before + i for i, r in enumerate(sorted({leg.rover for leg in legs_here}))}
        legs += [replace(leg, rover=number[leg.rover]) for leg in legs_here]
    return tuple(legs)


def tie_lines(area: SurveyArea, config: SwathConfig, heading_deg: float, after: FloatArray) -> list[Swath]:
    """Lay `config.tie_lines` straight lines square to the swaths, evenly over the area.

    `after` (2,): where the last swath ends [m]; the lines begin at the nearest corner.
    """
    if config.tie_lines == 0:
        return []
    # They run from border to border, whatever the swaths keep off it.
    across = {"swaths": config.tie_lines, "spacing_m": None, "heading_deg": heading_deg + 90.0}
    across |= {"outer_share": 0.5, "inset_share": 0.0}
    choices = []
    for corner in ("south-west", "south-east", "north-west", "north-east"):
        lines = reference_lines(area, config.model_copy(update={**across, "start": corner}))
        choices.append(lines.back_and_forth)
    axes = min(choices, key=lambda lines: float(np.hypot(*(lines[0][0] - after))))
    return [Swath(axis, axis) for axis in axes]
