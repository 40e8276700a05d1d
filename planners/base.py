"""From a pattern to a route: its swaths on the ground that there is, joined by transits."""

from collections.abc import Sequence

import numpy as np
import shapely

from planners.config import LawnmowerConfig, SteeredConfig, SwathConfig, WavyConfig
from planners.decomposition import clipped, swaths_on
from planners.energy import Mobility, predicted
from planners.lawnmower import lawnmower
from planners.ordering import connect
from planners.swaths import ReferenceLines, Swath, reference_lines, shortened
from planners.tie_lines import tie_lines
from planners.transit import FreeGround
from planners.wavy import wavy
from survey.area import SurveyArea
from survey.arrays import FloatArray
from survey.dem import Dem
from survey.errors import ConfigError
from survey.route import Leg, Route

Pattern = LawnmowerConfig | WavyConfig | SteeredConfig


def swath_route(
    area: SurveyArea,
    config: Pattern,
    *,
    slope_length_m: float | None = None,
    mobility: Mobility | None = None,
    prior: Dem | None = None,
) -> Route:
    """Lay a pattern of swaths over an area and join them.

    On a rectangle that the swaths run along, they are swept back and forth; on any other
    ground they are cut into cells and joined by the shortest transits found.
    """
    lines = reference_lines(area, config)
    swaths = _swaths(lines.back_and_forth, area, config, lines, slope_length_m)
    legs = _back_and_forth(swaths, area)
    if legs is None:
        swaths = _swaths(_axes_on(area, config, lines), area, config, lines, slope_length_m)
        legs = _joined(swaths, area, config)
    pattern = str(getattr(config, "pattern", "swaths"))
    return Route(legs, area.crs, pattern, lines.spacing_m, predicted(legs, mobility or Mobility(), prior))


def _swaths(
    axes: list[FloatArray],
    area: SurveyArea,
    config: Pattern,
    lines: ReferenceLines,
    slope_length_m: float | None,
) -> list[Swath]:
    if isinstance(config, WavyConfig):
        swaths = wavy(axes, area, config, lines.spacing_m, _wavelength_m(config, slope_length_m))
    else:
        swaths = lawnmower(axes)
    return swaths + tie_lines(area, config, lines.heading_deg, swaths[-1].xy[-1])


def _wavelength_m(config: WavyConfig, slope_length_m: float | None) -> float:
    if config.wavelength_m is not None:
        return config.wavelength_m
    if slope_length_m is None:
        raise ConfigError(
            "wavy swaths need a wavelength_m, or a prior or a kernel that tells how the terrain varies."
        )
    return config.wavelength_scales * slope_length_m


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


def _axes_on(area: SurveyArea, config: Pattern, lines: ReferenceLines) -> list[FloatArray]:
    """Cut the lines to ground of any shape, every metre proven to be on it."""
    ground = FreeGround(area.free)
    inset_m = config.inset_share * lines.spacing_m
    if config.outer_share == 0.5:
        axes = swaths_on(ground, lines.spacing_m, lines.heading_deg)
        return [shortened(axis, inset_m) for axis in axes]
    return clipped(ground, [axis for line in lines.lines for axis in line])


def _joined(swaths: Sequence[Swath], area: SurveyArea, config: SwathConfig) -> tuple[Leg, ...]:
    ground = FreeGround(area.free)
    kept = [Swath(xy, swath.axis) for swath in swaths for xy in clipped(ground, [swath.xy]) if len(xy) > 1]
    start = area.starts[0] if len(area.starts) else None
    if start is None and config.start is not None:
        first = reference_lines(area, config).lines[0][0][0]
        ends = np.vstack([swath.xy[[0, -1]] for swath in kept])
        start = ends[np.argmin(np.hypot(*(ends - first).T))]
    return connect([swath.xy for swath in kept], ground, start=start, axes=[swath.axis for swath in kept])
