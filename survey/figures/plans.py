"""Figures of plans: a route over the predicted standard deviation, plan sheets for printing, and the design of a season.

`plan_map` shows the area, the route and the standard deviation that it leads to. `season_plot` shows the error
against the number of swaths for each number of stakes, and the causes of the error of the chosen design.
`plan_sheets` draws A4 pages of a `PlanContent`: an overview, the predicted standard deviation, and one sheet for each
rover with a map at a round scale, facts, and tables of corners and swaths that continue on further pages.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from shapely import Polygon

from survey.core.arrays import Bounds
from survey.core.crs import crs_text
from survey.core.map_scale import ground_area_m2, ground_length_m
from survey.core.text import area_text, duration_text, energy_text, length_text, place_text
from survey.core.transformation import WGS84, transformed
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Leg, Route
from survey.figures.layout import (
    MapFigure,
    add_colour_bar,
    add_legend,
    draw_scale_and_north,
    label_maps,
    map_figure,
    widen,
)
from survey.figures.map_layers import (
    decimate,
    draw_area,
    draw_contours,
    draw_left_out,
    draw_raster,
    draw_relief,
    draw_route,
    draw_smooth,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.page_layout import Column, Page
from survey.figures.style import CLAIM, ELEVATION, ESTIMATE, FULL_IN, INK, MUTED, styled


@styled
def plan_map(
    area: SurveyArea,
    route: Route,
    *,
    terrain: Dem | None = None,
    std: Dem | None = None,
    left_out: Sequence[Polygon] = (),
) -> Figure:
    """Draw a planned route over the known terrain and the predicted standard deviation.

    Swaths are numbered in driving order and carry an arrow, transits are dashed, each
    rover has its colour. Colours show the predicted standard deviation of the map,
    or the elevation where no prediction is given.

    Parameters
    ----------
    area : SurveyArea
        Outline and no-go zones; ground outside is veiled.
    route : Route
        In the CRS of the area.
    terrain : Dem, optional
        Prior terrain, drawn as hillshade with contours.
    std : Dem, optional
        Predicted standard deviation, e.g. ``planners.predict_error(…).std`` [m].
    left_out : sequence of shapely.Polygon, optional
        Pieces of the area where rovers cannot be.

    $page

    Raises
    ------
    InputError
        When route or terrain are in another CRS than the area.

    Examples
    --------
    >>> from survey.data.route import Leg
    >>> area = SurveyArea.rectangle((0.0, 0.0, 40.0, 20.0), "EPSG:32608")
    >>> route = Route((Leg("swath", [[0.0, 10.0], [40.0, 10.0]]),), "EPSG:32608", "line")
    >>> plan_map(area, route).axes[0].get_title(loc="left")
    'Survey plan'
    """
    area.require_crs(route.crs, "the route")
    bounds = _extent(area)
    drawing = map_figure(FULL_IN, bounds)
    axes = drawing.maps[0]
    handles: list[Artist] = []
    if terrain is not None:
        area.require_crs(terrain.crs, "the terrain")
        terrain = decimate(terrain)
        handles += draw_contours(axes, terrain, within=area)
        draw_relief(axes, terrain, exaggeration=relief_exaggeration(terrain))
    axes.set(xlim=bounds[::2], ylim=bounds[1::2])
    handles += [*draw_area(axes, area), *draw_left_out(axes, left_out), *draw_route(axes, route)]
    if std is not None:
        image = draw_smooth(axes, std, area.free)
        add_colour_bar(image, drawing, "Predicted standard deviation [m]")
    elif terrain is not None:
        image = draw_raster(axes, terrain.elevation, terrain, ELEVATION, elevation_limits(terrain))
        add_colour_bar(image, drawing, "Elevation [m]")
    else:
        drawing.bar.set_axis_off()
    label_maps(drawing, "Survey plan", crs=area.crs)
    add_legend(drawing, handles)
    return drawing.figure


def _extent(area: SurveyArea) -> tuple[float, float, float, float]:
    """Return the extent of the map: the area with a margin of 4 %."""
    xmin, ymin, xmax, ymax = area.bounds
    pad = 0.04 * max(xmax - xmin, ymax - ymin)
    return widen((xmin - pad, ymin - pad, xmax + pad, ymax + pad))


@styled
def season_plot(
    errors: Mapping[int, Sequence[tuple[int, float]]],
    wanted: float,
    chosen: tuple[int, float],
    parts_m: Mapping[str, float],
    unit: str,
) -> Figure:
    """Draw the error of a season's mass balance against swaths, and the parts of the chosen design.

    `parts_m`: standard deviations of the chosen design by cause [m].
    """
    figure = Figure(figsize=(FULL_IN, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_errors(left, errors, wanted, chosen, unit)
    right.barh(list(parts_m), list(parts_m.values()), color=ESTIMATE)
    right.invert_yaxis()
    right.set_xlabel("Standard deviation (m)")
    right.set_title("Chosen design, by cause")
    return figure


def _draw_errors(
    axes: Axes,
    errors: Mapping[int, Sequence[tuple[int, float]]],
    wanted: float,
    chosen: tuple[int, float],
    unit: str,
) -> None:
    """Draw a line for each number of stakes, the wanted error, and the chosen design."""
    for index, (n_stakes, line) in enumerate(errors.items()):
        shade = 0.35 + 0.65 * index / max(len(errors) - 1, 1)
        axes.plot(
            *zip(*line, strict=True), color=ESTIMATE, alpha=shade, marker=".", label=f"{n_stakes} stakes"
        )
    axes.axhline(wanted, color=MUTED, linestyle="--", label="wanted")
    axes.plot(*chosen, "o", color=CLAIM, markeredgecolor=INK, label="chosen")
    axes.set_xlabel("Swaths")
    axes.set_ylabel(f"Half the 95 % interval ({unit})")
    axes.set_ylim(bottom=0.0)
    axes.legend()


class RoverEffort(NamedTuple):
    """Length [m], turns, time [s] and energy [J] of one rover, and the batteries that it uses up.

    `length_m`: length of its legs on the ground [m]. `n_turns`: number of turns. `time_s`: time of driving
    [s]. `energy_j`: energy that it takes from the battery [J]. `batteries`: energy in full batteries; None
    where the size of a battery was not stated.
    """

    length_m: float
    n_turns: int
    time_s: float
    energy_j: float
    batteries: float | None = None


@dataclass(frozen=True)
class PlanContent:
    """A plan with what its sheets state.

    `title`: name of the survey. `date`: date of the plan. `area`: outline and no-go zones. `route`: in the
    CRS of the area. `efforts`: one for each rover. `swaths_text`: number of swaths, such as ``"6 lines in 10
    pieces"``. `time_s`: time until the last rover is done [s]. `terrain`: prior terrain. `std`: predicted
    standard deviation of the map [m]. `left_out`: pieces of the area where rovers cannot be, with the reason.
    `assumptions`: what the numbers rest on, one sentence each. `field_work`: days, person-days and cost; empty
    without rates.
    """

    title: str
    date: str
    area: SurveyArea
    route: Route
    efforts: tuple[RoverEffort, ...]
    swaths_text: str
    time_s: float
    terrain: Dem | None = None
    std: Dem | None = None
    left_out: tuple[tuple[Polygon, str], ...] = ()
    assumptions: tuple[str, ...] = field(default_factory=tuple)
    field_work: str = ""


_ROVERS = (
    Column("Rover", 0.5, "left"),
    Column("Swaths", 0.55),
    Column("Length", 0.8),
    Column("Turns", 0.5),
    Column("Time", 0.9),
    Column("Energy", 0.9),
    Column("Batteries", 0.75),
    Column("Start", 1.6),
)
_CORNERS = (
    Column("Corner", 0.6, "left"),
    Column("Easting [m]", 1.0),
    Column("Northing [m]", 1.0),
    Column("Latitude and longitude (WGS 84)", 2.2),
)
_SWATHS = (
    Column("No.", 0.28),
    Column("Length [m]", 0.6),
    Column("Heading", 0.48),
    Column("From E, N [m]", 1.15),
    Column("From latitude, longitude", 1.45),
    Column("To E, N [m]", 1.15),
    Column("To latitude, longitude", 1.45),
)


_MOST_CORNERS = 250
"""Corners that are listed, on some eight pages; an outline that was traced from images has thousands."""


@styled
def plan_sheets(content: PlanContent) -> list[Figure]:
    """Draw the sheets of a plan on A4 pages."""
    pages = _overview(content)
    if content.std is not None:
        pages.append(_deviation_page(content, content.std))
    for rover in range(content.route.n_rovers):
        pages += _rover_sheets(content, rover)
    for number, page in enumerate(pages, start=1):
        page.number(number, len(pages))
    return [page.figure for page in pages]


def _overview(content: PlanContent) -> list[Page]:
    """Return the first page, and further ones for the corners of the area where they are worth a print."""
    route, area = content.route, content.area
    page = Page(content.title, f"Survey plan of {content.date}, made with firnline")
    scale = add_plan_map(page, content, route, 5.3)
    page.heading("Survey")
    page.facts(
        [
            ("Pattern", f"{route.pattern}, {content.swaths_text}"),
            ("Length", length_text(sum(effort.length_m for effort in content.efforts))),
            ("Time", f"{duration_text(content.time_s)}, until the last rover is done"),
            ("Energy", _energy_text(content.efforts)),
            ("Area", area_text(ground_area_m2(area.crs, area.polygon))),
            ("Scale of the map", f"1 : {scale:,}".replace(",", "\u2009")),
            ("CRS", f"{area.crs.name} ({_code(content)})"),
            ("Heights", _heights(content)),
            *([("Field work", content.field_work)] if content.field_work else []),
        ]
    )
    page.heading("Rovers")
    page.table(_ROVERS, [_rover_row(content, rover) for rover in range(route.n_rovers)])
    page.heading("Left out")
    page.paragraph(_left_out_text(content))
    page.heading("Assumptions")
    for assumption in content.assumptions:
        page.paragraph(assumption, bullet="• ")
    rows, title = _corner_rows(content), "Corners of the area"
    if len(rows) <= _MOST_CORNERS:
        return _with_table(page, title, _CORNERS, rows, content)
    pages = [page] if page.room_in > 0.8 else [page, Page(f"{content.title}: {title.lower()}", content.date)]
    pages[-1].heading(title)
    pages[-1].paragraph(f"{len(rows)} corners are too many for a table; the file of the area holds them.")
    return pages


def _deviation_page(content: PlanContent, std: Dem) -> Page:
    page = Page(f"{content.title}: predicted standard deviation", "Of the map that the survey will give")
    scale = add_deviation_map(page, content, std, 7.5)
    values = std.elevation[np.isfinite(std.elevation)]
    rmse_m = content.route.prediction.get("rmse_m", float(np.sqrt(np.mean(values**2))))
    page.heading("Prediction")
    page.facts(
        [
            ("Expected RMSE", f"{rmse_m:.2f} m over the area"),
            ("95 % of the area", f"below {np.percentile(values, 95.0):.2f} m"),
            ("Largest", f"{values.max():.2f} m"),
            ("Scale of the map", f"1 : {scale:,}".replace(",", "\u2009")),
        ]
    )
    page.paragraph(
        "The standard deviation of elevation, one sigma, as its assumptions on the first page give it."
    )
    return page


def _rover_sheets(content: PlanContent, rover: int) -> list[Page]:
    """Return the sheet of one rover, and further ones where it drives many swaths."""
    legs = tuple(Leg(leg.kind, leg.xy, 0, leg.axis) for leg in content.route.legs if leg.rover == rover)
    route = Route(legs, content.route.crs, content.route.pattern)
    effort = content.efforts[rover]
    page = Page(
        f"{content.title}: rover {rover + 1}", f"{content.date}, {_code(content)}, {content.area.crs.name}"
    )
    scale = add_plan_map(page, content, route, 6.0)
    page.heading("Drive")
    page.facts(
        [
            ("Length", f"{length_text(effort.length_m)}, {effort.n_turns} turns"),
            ("Time", duration_text(effort.time_s)),
            ("Energy", _energy_text([effort])),
            ("Scale of the map", f"1 : {scale:,}".replace(",", "\u2009")),
        ]
    )
    return _with_table(page, "Swaths in driving order", _SWATHS, _swath_rows(route), content)


def _with_table(
    page: Page, title: str, columns: Sequence[Column], rows: list[list[str]], content: PlanContent
) -> list[Page]:
    """Write a table on a page and on as many further ones as it needs."""
    pages = [page]
    rest = rows
    while rest:
        if pages[-1].room_in > 0.8:
            pages[-1].heading(title if len(rest) == len(rows) else f"{title}, continued")
            rest = rest[pages[-1].table(columns, rest) :]
        if rest:
            pages.append(Page(f"{content.title}: {title.lower()}", content.date))
    return pages


def _rover_row(content: PlanContent, rover: int) -> list[str]:
    effort = content.efforts[rover]
    swaths = [leg for leg in content.route.swaths if leg.rover == rover]
    start = content.route.path(rover)[0]
    return [
        str(rover + 1),
        str(len(swaths)),
        length_text(effort.length_m),
        str(effort.n_turns),
        duration_text(effort.time_s),
        energy_text(effort.energy_j),
        "–" if effort.batteries is None else f"{effort.batteries:.2f}",
        place_text(*transformed(start[None, :], content.route.crs, WGS84, "the route")[0]),
    ]


def _corner_rows(content: PlanContent) -> list[list[str]]:
    """Return number, grid and degrees of the corners of the area, part by part, and of its holes."""
    rows = []
    parts = shapely.get_parts(content.area.polygon)
    rings = [(f"{i + 1}." if len(parts) > 1 else "", part.exterior) for i, part in enumerate(parts)]
    rings += [(f"hole {i + 1}.", ring) for i, ring in enumerate(r for part in parts for r in part.interiors)]
    for prefix, ring in rings:
        corners = shapely.get_coordinates(ring)[:-1]
        degrees = transformed(corners, content.area.crs, WGS84, "the area")
        for number, ((east, north), place) in enumerate(zip(corners, degrees, strict=True), start=1):
            rows.append([f"{prefix}{number}", f"{east:,.1f}", f"{north:,.1f}", place_text(*place)])
    return [[cell.replace(",", "\u2009") for cell in row] for row in rows]


def _swath_rows(route: Route) -> list[list[str]]:
    rows = []
    for number, leg in enumerate(route.swaths, start=1):
        ends = leg.xy[[0, -1]]
        east, north = ends[1] - ends[0]
        heading = np.degrees(np.arctan2(east, north)) % 360.0
        places = transformed(ends, route.crs, WGS84, "the route")
        (start, end), (here, there) = ends, [f"{lat:.6f}, {lon:.6f}" for lon, lat in places]
        cells = [str(number), f"{ground_length_m(route.crs, leg.xy):.0f}", f"{heading:.0f}°"]
        rows.append([*cells, f"{start[0]:.1f}, {start[1]:.1f}", here, f"{end[0]:.1f}, {end[1]:.1f}", there])
    return rows


def _left_out_text(content: PlanContent) -> str:
    if not content.left_out:
        return "Nothing: rovers reach all of the area outside its no-go zones."
    total = sum(piece.area for piece, _ in content.left_out)
    reasons = areas_by_reason(content.left_out).items()
    parts = [f"{area_text(area)} {reason} ({n} piece{'s' * (n > 1)})" for reason, (area, n) in reasons]
    return f"{total / content.area.free.area:.1%} of the area: {', '.join(parts)}."


def _energy_text(efforts: Sequence[RoverEffort]) -> str:
    text = energy_text(sum(effort.energy_j for effort in efforts))
    if any(effort.batteries is None for effort in efforts):
        return f"{text} (no battery stated)"
    return f"{text}, {sum(effort.batteries or 0.0 for effort in efforts):.2f} batteries"


def _heights(content: PlanContent) -> str:
    if content.terrain is None:
        return "no prior terrain; level ground assumed"
    return content.terrain.vertical_datum or "vertical datum not stated"


def _code(content: PlanContent) -> str:
    text = crs_text(content.area.crs)
    return text if len(text) < 20 else "no code"


_MARGIN = 0.03


def add_plan_map(page: Page, content: PlanContent, route: Route, tallest_in: float) -> int:
    """Add the map of a route to a page; return the denominator of its scale."""
    axes, scale = page.map_axes(_view(content.area, route), tallest_in)
    limits = axes.get_xlim(), axes.get_ylim()
    handles: list[Artist] = []
    if content.terrain is not None:
        terrain = content.terrain
        image = draw_raster(axes, terrain.elevation, terrain, ELEVATION, elevation_limits(terrain))
        draw_relief(axes, terrain, exaggeration=relief_exaggeration(terrain))
        handles += draw_contours(axes, terrain, within=content.area)
        _colour_bar(page, axes, image, "Elevation [m]")
    axes.set(xlim=limits[0], ylim=limits[1])
    handles += [
        *draw_area(axes, content.area),
        *draw_left_out(axes, [piece for piece, _ in content.left_out]),
        *draw_route(axes, route),
    ]
    _finish(page, axes, content, handles)
    return scale


def add_deviation_map(page: Page, content: PlanContent, std: Dem, tallest_in: float) -> int:
    """Add the map of the predicted standard deviation, with the swaths; return the denominator of its scale."""
    axes, scale = page.map_axes(_view(content.area, content.route), tallest_in)
    image = draw_smooth(axes, std, content.area.free)
    for leg in content.route.swaths:
        axes.plot(*leg.xy.T, color=INK, linewidth=0.6, alpha=0.7, zorder=3.5)
    handles: list[Artist] = [*draw_area(axes, content.area, veil=False)]
    _colour_bar(page, axes, image, "Predicted standard deviation [m]")
    _finish(page, axes, content, handles)
    return scale


def _view(area: SurveyArea, route: Route) -> Bounds:
    """Return the bounds of area and route, with a margin."""
    places = np.vstack([leg.xy for leg in route.legs])
    west, south, east, north = area.bounds
    xmin, ymin = min(west, places[:, 0].min()), min(south, places[:, 1].min())
    xmax, ymax = max(east, places[:, 0].max()), max(north, places[:, 1].max())
    pad = _MARGIN * max(xmax - xmin, ymax - ymin)
    return float(xmin - pad), float(ymin - pad), float(xmax + pad), float(ymax + pad)


def _colour_bar(page: Page, axes: Axes, image: ScalarMappable, label: str) -> None:
    bar = page.figure.colorbar(image, cax=page.bar_axes(axes))
    bar.set_label(label, fontsize=7.0)
    bar.ax.tick_params(labelsize=6.5)
    bar.outline.set_visible(False)


def _finish(page: Page, axes: Axes, content: PlanContent, handles: list[Artist]) -> None:
    """Add scale bar, north arrow and legend."""
    draw_scale_and_north(MapFigure(page.figure, [axes], axes), crs=content.area.crs)
    axes.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.0, -0.36 / (axes.get_position().height * page.figure.get_figheight())),
        ncols=min(len(handles), 6),
        fontsize=6.8,
        borderaxespad=0.0,
        columnspacing=1.2,
        handlelength=1.6,
    )
    page.top_in -= 0.14 * math.ceil(len(handles) / 6) + 0.06


def areas_by_reason(left_out: tuple[tuple[Polygon, str], ...]) -> dict[str, tuple[float, int]]:
    """Return area [m², in the CRS] and number of pieces by reason, the largest area first."""
    found: dict[str, tuple[float, int]] = {}
    for piece, reason in left_out:
        area, count = found.get(reason, (0.0, 0))
        found[reason] = (area + piece.area, count + 1)
    return dict(sorted(found.items(), key=lambda entry: -entry[1][0]))
