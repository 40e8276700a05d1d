"""Every picture that a command makes can be printed: letters of 6 pt or more, nothing cut by the edge, fonts embedded."""

import ast
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
import shapely

from sim.mission.rehearsal import fault_tree, fault_tree_plot, summarize_outcomes
from sim.montecarlo.results import error_curves
from survey import figures as drawn
from survey.core import BoolArray
from survey.core.files import PictureKind
from survey.data.dem import Dem
from survey.data.surface_points import SurfacePoints
from survey.figures import calibration, errors, maps, paths, plans
from survey.figures.layout import PAPERS_MM, arranged, is_wide
from survey.figures.style import FULL_IN, picture_bytes
from survey.reconstruction import FreeSurface
from survey.reconstruction.checks import PredictiveCheck, PredictiveScores
from survey.reconstruction.lattice.steep_places import steep_sections
from survey.reporting.rendering import PictureForm
from survey.scoring import Change, Checkpoints, CloudDistances, ErrorStatistics, compare, m3c2
from tests.printing import assert_fonts_embedded, assert_printable
from tests.sim.mission.test_fault_tree import FOUND
from tests.survey import conftest
from tests.survey.figures.test_season import ERRORS, PARTS
from tests.survey.figures.test_sheets import content
from tests.test_structure import ROOT, product
from vision_slam.extended_map import ExtendedMap
from vision_slam.orthoimage import Orthoimage
from vision_slam.plotting import extended_map
from vision_slam.scan_agreement import HeightErrors

site, scored = conftest.site, conftest.scored
_ELSEWHERE = {
    "calibration_figure": "tests/vision_slam/test_calibrate.py",
    "tracks_on_frames": "tests/vision_slam/test_recordings.py",
    "features_on_photographs": "tests/vision_slam/test_photographs.py",
    "document_pages": "tests/survey/reporting/test_document.py",
}
"""Figures that need images or a whole report, with the file of their test."""


def _left_half(site: SimpleNamespace) -> BoolArray:
    """Return which nodes (H, W) of a map lie in its left half."""
    rows, columns = site.reconstruction.mean.elevation.shape
    return np.tile(np.arange(columns) < columns // 2, (rows, 1))


def _rows() -> list[dict[str, Any]]:
    return [
        {
            "terrain": "hills", "planner": planner, "map": "gp", "swaths": n, "mean_length_m": 600.0 * n,
            "mean_rmse_m": 2.0 / n, "mean_rmse_m_low": 1.6 / n, "mean_rmse_m_high": 2.4 / n,
        }
        for planner in ("lawnmower", "wavy") for n in (2, 4, 8)
    ]  # fmt: skip


def _distances(s: SimpleNamespace) -> CloudDistances:
    """Distances between two clouds at the nodes of the site; the later one sank in the west."""
    xyz = np.column_stack([s.grid.xy, s.truth.elevation.ravel()])
    sank = np.column_stack(
        [s.grid.xy, s.truth.elevation.ravel() - 0.5 * (s.grid.xy[:, 0] < xyz[:, 0].mean())]
    )
    later, earlier = (SurfacePoints(one, sigma_m=0.1, crs=s.grid.crs) for one in (sank, xyz))
    return m3c2(later, earlier, registration_m=0.05, cylinder_m=25.0, depth_m=20.0, spacing_m=10.0)


def _change(site: SimpleNamespace) -> Change:
    difference = Dem.on(site.grid, site.truth.elevation - 1500.0)
    return Change(difference, np.full(site.grid.shape, 0.2), np.ones(site.grid.shape), (), "variogram")


def _check() -> PredictiveCheck:
    scores = PredictiveScores.of(np.linspace(-0.2, 0.2, 40), np.full(40, 0.1))
    return PredictiveCheck("swaths", 4, scores, scores, (1.0, 5.0), (9.0, 4.0), (0.4, 0.3), (1.0, 1.0))


def _overhanging_face() -> Any:
    """Draw a face 3 m high that leans over by 18°, its ends without support."""
    north, up = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 14.1, 0.5), np.arange(0.0, 3.1, 0.5)))
    nodes = np.column_stack([-up / 3.0, north, up])
    first = np.arange(len(nodes)).reshape(7, 29)
    a, b, c, d = (part.ravel() for part in (first[:-1, :-1], first[:-1, 1:], first[1:, 1:], first[1:, :-1]))
    triangles = np.vstack([np.column_stack([a, c, b]), np.column_stack([a, d, c])])
    sigma = np.where(up < 1.0, 0.2, 0.02)
    surface = FreeSurface(nodes, triangles, nodes, sigma, up >= 1.0, 0.5, 0.1, 0.01, (1.0, 1.0))
    returns = SurfacePoints(nodes, sigma_m=0.02, origins=nodes * 0.0 - [8.0, 0.0, 0.0], crs="EPSG:32608")
    return drawn.overhang_sections(surface, steep_sections(surface), returns)


def _residuals(site: SimpleNamespace) -> Any:
    xyz = site.points.xyz + [0.0, 0.0, 0.1]
    names = tuple(f"Mark {k}" for k in range(24))
    return compare(site.truth, Checkpoints(xyz[:24], np.full(24, 0.02), names=names, crs=site.grid.crs))


FIGURES: dict[str, Callable[[SimpleNamespace, Any], Any]] = {
    "survey_map": lambda s, _: drawn.survey_map(s.reconstruction.mean, area=s.area, route=s.route),
    "terrain_comparison": lambda s, _: drawn.terrain_comparison(s.truth, s.reconstruction, s.prior, area=s.area),
    "deviation_map": lambda s, _: drawn.deviation_map(s.reconstruction, area=s.area, route=s.route),
    "support_map": lambda s, _: drawn.support_map(s.reconstruction, area=s.area, route=s.route),
    "width_map": lambda s, _: drawn.width_map(s.reconstruction, width_in=FULL_IN),
    "quantity_plot": lambda s, _: maps.quantity_plot(s.truth, "air_temperature [degC]", area=s.area, route=s.route),
    "uncertainty_plot": lambda s, _: maps.uncertainty_plot(s.truth, "snow_depth [m]", area=s.area, route=s.route),
    "probability_plot": lambda s, _: maps.probability_plot(s.truth, "Slope above 20°", area=s.area, route=s.route),
    "intensity_map": lambda s, _: maps.intensity_map(s.truth, s.route.path(), (s.truth.xy[0], 40.0)),
    "interval_map": lambda s, _: maps.interval_map(s.truth, s.route.path()),
    "landmark_map": lambda s, _: drawn.landmark_map(s.points, s.truth, area=s.area, route=s.route),
    "change_map": lambda s, _: drawn.change_map(_change(s), {"ice": s.area.polygon}),
    "distance_map": lambda s, _: drawn.distance_map(_distances(s), {"ice": s.area.polygon}),
    "error_map": lambda s, _: drawn.error_map(s.reconstruction, s.truth, area=s.area, route=s.route),
    "error_histogram": lambda s, score: drawn.error_histogram(s.reconstruction, s.truth, score.elevation, area=s.area),
    "error_against_distance": lambda s, _: drawn.error_against_distance(s.reconstruction, s.truth, s.route),
    "residual_map": lambda s, _: errors.residual_map(_residuals(s), s.truth, s.area),
    "residual_histogram": lambda s, _: errors.residual_histogram(s.error, ErrorStatistics.of(s.error)),
    "residual_quantiles": lambda s, _: errors.residual_quantiles(s.error.ravel(), ErrorStatistics.of(s.error)),
    "terrain_profile": lambda s, _: drawn.terrain_profile(s.reconstruction, s.truth, s.route, prior=s.prior),
    "calibration_plot": lambda s, score: drawn.calibration_plot(s.reconstruction, s.truth, score.calibration),
    "held_out_plot": lambda *_: calibration.held_out_plot(_check()),
    "withheld_plot": lambda s, _: calibration.withheld_plot(
        {0.5: 0.48, 0.95: 0.94}, np.full((4, 4), 0.94), s.grid.bounds, s.grid.crs
    ),
    "path_map": lambda s, _: drawn.path_map(
        s.trajectory.position, s.trajectory.covariance, landmarks=s.points.xyz, landmark_sigma_m=s.points.sigma_z,
        fixes=s.trajectory.position[::5], reference=s.reference_trajectory.position,
        is_lost=s.trajectory.health < 0.5, crs=s.grid.crs,
    ),
    "error_over_distance": lambda s, _: paths.error_over_distance(
        s.trajectory.position, s.reference_trajectory.position, s.trajectory.covariance, s.trajectory.health < 0.5
    ),
    "extended_map": lambda s, _: extended_map(
        ExtendedMap(s.reconstruction, s.reconstruction, s.points, HeightErrors(1.0, 0.1, 1e-3, 9, 9, 0.9), (), _left_half(s)),
        Orthoimage(np.full((1, *s.reconstruction.mean.elevation.shape), 120.0), s.reconstruction.mean.grid()),
        s.trajectory.position[:, :2],
    ),
    "overhang_sections": lambda *_: _overhanging_face(),
    "error_over_time": lambda s, _: drawn.error_over_time(s.trajectory, s.reference_trajectory),
    "executed_route": lambda s, _: drawn.executed_route(s.route, s.trajectory.position, s.trajectory.position, area=s.area),
    "deviation_from_route": lambda s, _: paths.deviation_from_route(s.route, s.trajectory.position, s.trajectory.position),
    "plan_map": lambda s, _: drawn.plan_map(
        s.area, s.route, terrain=s.truth, std=s.reconstruction.std, left_out=[shapely.box(*s.area.bounds).buffer(-80.0)]
    ),
    "season_plot": lambda *_: plans.season_plot(ERRORS, 0.3, (4, 0.29), PARTS, "m w.e."),
    "plan_sheets": lambda *_: plans.plan_sheets(content()),
    "fault_tree_plot": lambda *_: fault_tree_plot(summarize_outcomes(FOUND), fault_tree(FOUND)),
    "error_curves": lambda *_: error_curves({"hills": _rows()}, 0.4572),
}  # fmt: skip
"""Every public function of the product that returns figures, on a small world."""


def _functions_that_draw() -> Iterator[str]:
    for _, tree, _ in product():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and node.returns:
                kind = ast.unparse(node.returns)
                yield from [node.name] if kind in ("Figure", "list[Figure]") else []


def test_every_function_that_draws_is_measured() -> None:
    assert set(_functions_that_draw()) == {*FIGURES, *_ELSEWHERE}
    for name, file in _ELSEWHERE.items():
        text = (ROOT / file).read_text(encoding="utf-8")
        assert f"{name}(" in text
        assert "assert_printable(" in text


@pytest.mark.parametrize("name", FIGURES)
def test_letters_are_readable_in_print_and_nothing_is_cut(
    name: str, site: SimpleNamespace, scored: Any
) -> None:
    found = FIGURES[name](site, scored)
    sheets = found if isinstance(found, list) else [found]
    for figure in sheets:
        assert_printable(figure, **({"share": 1.0} if found is sheets else {}))


_ALONE = [name for name in FIGURES if name != "plan_sheets"]
# The narrowest columns are the hardest; the others are left to the exhaustive tests.
_COLUMNS = [
    name if name == "copernicus" else pytest.param(name, marks=pytest.mark.exhaustive) for name in PAPERS_MM
]


@pytest.mark.long
@pytest.mark.parametrize("paper", _COLUMNS)
@pytest.mark.parametrize("name", _ALONE)
def test_figures_fit_the_columns_of_a_publisher(
    name: str,
    paper: str,
    site: SimpleNamespace,
    scored: Any,
) -> None:
    figure = FIGURES[name](site, scored)
    width_in = PAPERS_MM[paper][is_wide(figure)] / 25.4

    with arranged(figure, width_in):
        assert figure.get_figwidth() == pytest.approx(width_in)
        assert_printable(figure, share=1.0)


@pytest.mark.long
@pytest.mark.parametrize("name", _ALONE)
def test_fonts_are_embedded(
    name: str,
    site: SimpleNamespace,
    scored: Any,
) -> None:
    figure = FIGURES[name](site, scored)
    assert_fonts_embedded(picture_bytes(figure, "pdf"), picture_bytes(figure, "svg"))


@pytest.mark.parametrize("kind", get_args(PictureKind))
def test_equal_figures_give_equal_bytes(kind: PictureKind) -> None:
    first, second = (
        picture_bytes(plans.season_plot(ERRORS, 0.3, (4, 0.29), PARTS, "m"), kind) for _ in range(2)
    )
    assert first == second


def test_a_figure_for_a_paper_has_the_width_of_its_columns(site: SimpleNamespace) -> None:
    svg = PictureForm("svg", "ieee").render(drawn.deviation_map(site.reconstruction))
    assert float(ET.fromstring(svg).attrib["width"].removesuffix("pt")) == pytest.approx(88.9 / 25.4 * 72.0)
