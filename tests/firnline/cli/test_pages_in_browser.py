"""All pages are accessible, fit a phone and print in few pages, as seen by a browser."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmarks.small_inputs import IDEAL_MISSION
from firnline.cli.main import app
from tests.accessibility import violations
from tests.docs.scratch import make_scratch

pytestmark = pytest.mark.walkthrough

PAGES = ("run", "fleet", "montecarlo", "score", "change")
MOST_PRINTED = 10
# Figures have 240 pixels per inch; at less than 0.33 of that, letters of 8 points are less than 9 pixels tall.
LEAST_SHOWN = 0.33
FLEET = """
schema_version = 1
name = "fleet"
fidelity = "ideal"
[terrain]
source = "random"
size_m = 150.0
step_m = 3.0
origin_m = [500000.0, 6700000.0]
[area]
starts_m = [[500010.0, 6700010.0]]
[planner]
pattern = "lawnmower"
swaths = 4
[fleet]
rovers = 2
[[payload]]
name = "air_temperature"
unit = "degC"
per_km_of_elevation = -6.5
field_length_m = 60.0
"""
STUDY = """
schema_version = 1
name = "study"
trials = 2
swaths = [3, 5]
[[terrains]]
name = "hills"
source = "random"
family = "squared-exponential"
length_scale_m = 100.0
[[planners]]
pattern = "lawnmower"
"""
PANNING = """() => [...document.querySelectorAll("figure, figure > :not(figcaption)")]
    .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.outerHTML.slice(0, 80))"""
SMALLEST = (
    """() => Math.min(...[...document.querySelectorAll("img")].map(e => e.clientWidth / e.naturalWidth))"""
)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Pages of a run, a run of two rovers with a payload, a score, a change and a study."""
    folder = tmp_path_factory.mktemp("pages")
    make_scratch(folder)
    for name, text in {"mission": IDEAL_MISSION, "fleet": FLEET, "study": STUDY}.items():
        (folder / f"{name}.toml").write_text(text)
    checkpoints = ["--checkpoints", "gnss.csv", "--class", "0.10", "--by", "slope", "--language", "de"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        firnline("run", "mission.toml", "--runs", "runs", "-q")
        firnline("run", "fleet.toml", "--runs", "runs", "-q")
        firnline("montecarlo", "study.toml", "--runs", "studies", "--engine", "serial", "-q")
        firnline("score", "map.tif", *checkpoints, "--report", "score")
        firnline(
            "change", "2026.tif", "2024.tif", "--outline", "glacier.gpkg", "-o", "c", "--report", "change"
        )
    return {
        "run": next(folder.glob("runs/small/*/6-report/index.html")),
        "fleet": next(folder.glob("runs/fleet/*/6-report/index.html")),
        "montecarlo": next(folder.glob("studies/study/**/index.html")),
        "score": folder / "score" / "index.html",
        "change": folder / "change" / "index.html",
    }


def firnline(*args: str) -> None:
    done = CliRunner().invoke(app, list(args))
    assert done.exit_code == 0, done.output


@pytest.fixture(
    params=[
        pytest.param((390, "light"), marks=pytest.mark.exhaustive),
        (390, "dark"),
        (1280, "light"),
        pytest.param((1280, "dark"), marks=pytest.mark.exhaustive),
    ]
)
def page(request: pytest.FixtureRequest, browser: Any) -> Iterator[Any]:
    """An empty page of a phone or a screen, in light or dark colours."""
    width_px, scheme = request.param
    # axe-core is a script of the test, which the pages' policy forbids.
    context = browser.new_context(
        viewport={"width": width_px, "height": 900}, color_scheme=scheme, bypass_csp=True
    )
    yield context.new_page()
    context.close()


@pytest.mark.parametrize("name", PAGES)
def test_a_page_has_no_violation_and_is_legible_without_scrolling_sideways(
    pages: dict[str, Path], page: Any, name: str
) -> None:
    page.goto(pages[name].as_uri())
    assert violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"]
    assert page.evaluate(PANNING) == []
    assert page.evaluate(SMALLEST) >= LEAST_SHOWN


@pytest.mark.parametrize("name", PAGES)
def test_a_page_prints_on_few_sheets_without_its_settings(
    pages: dict[str, Path], browser: Any, name: str
) -> None:
    page = browser.new_page()
    page.goto(pages[name].as_uri())
    n_sheets = len(re.findall(rb"/Type\s*/Page[^s]", page.pdf(format="A4", prefer_css_page_size=True)))
    page.close()
    assert 1 <= n_sheets <= MOST_PRINTED
