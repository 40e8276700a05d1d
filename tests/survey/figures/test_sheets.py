"""Plan sheets: what they state, and that nothing on them overlaps or leaves the page."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg

from survey import Dem, Grid, Route, SurveyArea
from survey.data.route import Leg
from survey.figures.map_layers import draw_contours
from survey.figures.page_layout import RIGHT_IN, WIDTH_IN, pdf_bytes
from survey.figures.plans import PlanContent, RoverEffort, plan_sheets

CRS = "EPSG:32608"
AREA = SurveyArea(shapely.box(526_000.0, 6_478_000.0, 526_600.0, 6_478_400.0), CRS)
GRID = Grid((525_700.0, 6_477_700.0, 526_900.0, 6_478_700.0), 20.0, CRS)
GROUND = Dem.on(GRID, (GRID.xy[:, 0] - 525_700.0).reshape(GRID.shape) * 0.1, "EGM2008 height")


def legs(n: int, rover: int) -> list[Leg]:
    found: list[Leg] = []
    for k in range(n):
        y = 6_478_010.0 + 380.0 * k / n + rover
        ends = [[526_000.0, y], [526_600.0, y]]
        line = ends if k % 2 == 0 else ends[::-1]
        if found:
            found.append(Leg("transit", [found[-1].xy[-1], line[0]], rover))
        found.append(Leg("swath", line, rover))
    return found


def content(n: int = 6, **others: object) -> PlanContent:
    route = Route((*legs(n, 0), *legs(n, 1)), CRS, "lawnmower")
    efforts = (RoverEffort(3600.0, 10, 10_560.0, 5.33e6, 0.74), RoverEffort(3600.0, 10, 3000.0, 1e6, 0.14))
    std = Dem.on(GRID, np.where(AREA.contains(GRID.xy), 0.8, np.nan).reshape(GRID.shape))
    left_out = ((shapely.box(526_000.0, 6_478_000.0, 526_100.0, 6_478_048.0), "too steep"),)
    return PlanContent(
        "tongue", "1 May 2026", AREA, route, efforts, "6 lines in 10 pieces", 10_560.0, GROUND, std, left_out,
        ("Time and energy: 1 m/s.",),
    )  # fmt: skip


def words(figure) -> list[str]:
    return [text.get_text() for text in figure.texts]


def test_there_is_an_overview_a_prediction_and_a_sheet_for_each_rover():
    figures = plan_sheets(content())
    assert [words(figure)[0] for figure in figures] == [
        "tongue",
        "tongue: predicted standard deviation",
        "tongue: rover 1",
        "tongue: rover 2",
    ]
    first = "\n".join(words(figures[0]))
    for fact in (
        "lawnmower, 6 lines in 10 pieces",
        "7.20 km",
        "2 h 56 min, until the last rover is done",
        "1.76 kWh, 0.88 batteries",
        "24 ha",
        "WGS 84 / UTM zone 8N (EPSG:32608)",
        "EGM2008 height",
        "2.0% of the area: 4800 m² too steep (1 piece).",
        "• Time and energy: 1 m/s.",
        "58.445528° N 134.554588° W",
        "1 May 2026",
        "page 1 of 4",
    ):
        assert fact in first
    assert any(text.startswith("1 : 5") for text in words(figures[0]))


def test_thousands_of_corners_are_counted_not_printed():
    traced = SurveyArea(shapely.Point(526_300.0, 6_478_200.0).buffer(199.0, quad_segs=500), CRS)
    figures = plan_sheets(replace(content(), area=traced))
    assert len(figures) == 4
    assert "2000 corners are too many for a table; the file of the area holds them." in words(figures[0])


@pytest.mark.parametrize("n", [6, 90])
def test_texts_neither_overlap_nor_leave_the_page(n):
    for figure in plan_sheets(content(n)):
        renderer = FigureCanvasAgg(figure).get_renderer()
        boxes = [text.get_window_extent(renderer) for text in figure.texts]
        for text, box in zip(figure.texts, boxes, strict=True):
            assert box.x0 > 0.0, text.get_text()
            assert box.x1 < figure.bbox.x1, text.get_text()
            assert box.y0 > 0.0, text.get_text()
        for (a, box), (b, other) in combinations(zip(figure.texts, boxes, strict=True), 2):
            covered = min(box.x1, other.x1) - max(box.x0, other.x0) > 0.5 and (
                min(box.y1, other.y1) - max(box.y0, other.y0) > 0.5
            )
            assert not covered, (a.get_text(), b.get_text())


def _on_polar_ice() -> PlanContent:
    """Return a plan whose title and CRS have long names."""
    polar, made = "EPSG:3413", content()
    area = SurveyArea(shapely.transform(AREA.polygon, lambda xy: xy - [820_000.0, 8_378_000.0]), polar)
    moved = [Leg(leg.kind, leg.xy - [820_000.0, 8_378_000.0], leg.rover) for leg in made.route.legs]
    route = Route(tuple(moved), polar, "lawnmower")
    title = "RGI2000-v7.0-G-05_greenland_periphery_outlines"
    return replace(made, title=title, area=area, route=route, terrain=None, std=None, left_out=())


def test_the_overview_states_the_field_work():
    stated = "2 days, 6 person-days, 3900 EUR"
    assert stated in words(plan_sheets(replace(content(), field_work=stated))[0])
    assert "Field work" not in words(plan_sheets(content())[0])


@pytest.mark.parametrize("made", [content(), _on_polar_ice()], ids=["short", "long"])
def test_texts_end_at_the_right_margin(made):
    for figure in plan_sheets(made):
        renderer = FigureCanvasAgg(figure).get_renderer()
        margin = figure.bbox.x1 * (1.0 - RIGHT_IN / WIDTH_IN)
        beyond = [t.get_text() for t in figure.texts if t.get_window_extent(renderer).x1 > margin + 1.0]
        assert beyond == []


def test_the_prediction_states_the_error_of_the_plan():
    made = content()
    planned = replace(made, route=Route(made.route.legs, CRS, "lawnmower", None, {"rmse_m": 0.77}))
    assert "0.77 m over the area" in words(plan_sheets(planned)[1])
    assert "0.80 m over the area" in words(plan_sheets(made)[1])


def test_tables_go_on_on_further_pages():
    figures = plan_sheets(content(90))
    assert len(figures) == 6
    assert "Swaths in driving order, continued" in words(figures[3])


def test_the_same_sheets_give_the_same_bytes():
    first, second = (pdf_bytes(plan_sheets(content()), "tongue") for _ in range(2))
    assert first == second
    assert first.startswith(b"%PDF")


def test_contours_fit_the_relief_of_the_area():
    from matplotlib.figure import Figure

    x, _ = np.meshgrid(GRID.x, GRID.y)
    # A flat tongue of 12 m relief below walls of 300 m.
    walls = Dem.on(GRID, 0.02 * (x - 526_000.0) + np.where(x > 526_640.0, (x - 526_640.0) * 1.2, 0.0))
    axes = Figure().add_subplot()
    assert [line.get_label() for line in draw_contours(axes, walls)] == ["Contours, 20 m"]
    assert [line.get_label() for line in draw_contours(axes, walls, within=AREA)] == ["Contours, 2 m"]
