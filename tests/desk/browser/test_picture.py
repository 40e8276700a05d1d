"""The pictures of the documentation: ``FIRNLINE_PICTURES=docs/images`` writes them again."""

import io
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from desk.terrain.pyramid import heights_at
from desk.workspace import Workspace, open_workspace, write_demo
from live.watch.log import line_of, watch_header
from live.watch.survey_watch import SurveyWatch
from planners.guarantee.adaptive import AdaptiveConfig
from tests.desk.browser.conftest import DeskPage
from tests.desk.conftest import DeskServer

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(1500)]

ARROW = ((0, 0), (0, 17), (4, 13), (7, 20), (10, 19), (7, 12), (12, 12))
LARGEST_BYTES = 1_500_000


@pytest.fixture
def demo(browser, tmp_path) -> Iterator[DeskPage]:
    """The page, open on the sample site."""
    with open_workspace(write_demo(tmp_path / "demo"), tmp_path) as workspace:
        server = DeskServer(workspace)
        context = browser.new_context(viewport={"width": 1280, "height": 760})
        opened = DeskPage(context, server).open()
        opened.wait_for_error()
        name_the_folder(opened)
        opened.page.wait_for_timeout(600)
        yield opened
        context.close()
        server.stop()


def name_the_folder(opened: DeskPage) -> None:
    """Show a folder that a user could have in place of the test's own one."""
    opened.page.evaluate("document.querySelector('#saved').textContent = 'Stored in /home/ada/survey'")


class Recorder:
    """Screenshots with the time for which each is shown, and the place of the pointer."""

    def __init__(self, demo: DeskPage) -> None:
        self.demo = demo
        self.frames: list[Image.Image] = []
        self.shown_ms: list[int] = []
        self.pointer = (640.0, 700.0)

    def shoot(self, seconds: float) -> None:
        """Take a screenshot that is shown for some seconds."""
        picture = Image.open(io.BytesIO(self.demo.page.screenshot())).convert("RGB")
        x, y = self.pointer
        outline = [(x + u, y + v) for u, v in ARROW]
        ImageDraw.Draw(picture).polygon(outline, fill="black", outline="white")
        self.frames.append(picture.resize((960, 570), Image.Resampling.LANCZOS))
        self.shown_ms.append(int(1000 * seconds))

    def click(self, selector: str, seconds: float = 0.6) -> None:
        """Click a control and show what happens."""
        box = self.demo.page.locator(selector).first.bounding_box()
        self.pointer = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        self.demo.page.locator(selector).first.click()
        self.demo.page.wait_for_timeout(150)
        self.shoot(seconds)

    def click_map(self, x: float, y: float) -> None:
        """Click a place of the map."""
        self.pointer = self.demo.pixel(x, y)
        self.demo.click(x, y)
        self.shoot(0.4)

    def slide(self, selector: str, values: list[float], seconds: float) -> None:
        """Move a slider through values."""
        for value in values:
            self.demo.page.locator(selector).evaluate(
                "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }",
                str(value),
            )
            self.demo.page.wait_for_timeout(60)
            self.shoot(seconds)

    def webp(self) -> bytes:
        """Return the animation."""
        buffer = io.BytesIO()
        first, *others = self.frames
        settings = {"duration": self.shown_ms, "loop": 0, "quality": 55, "method": 4, "minimize_size": False}
        first.save(buffer, "WEBP", save_all=True, append_images=others, **settings)
        return buffer.getvalue()


def save_picture(name: str, content: bytes) -> None:
    """Write a picture where the variable of the environment says."""
    if "FIRNLINE_PICTURES" in os.environ:
        Path(os.environ["FIRNLINE_PICTURES"], name).write_bytes(content)


def test_the_demo_is_pictured(demo):
    picture = demo.page.screenshot()
    assert " m (" in demo.page.inner_text("#rmse")
    assert len(picture) > 50_000
    save_picture("desk.png", picture)


def test_the_demo_is_recorded(demo):
    film = Recorder(demo)
    film.shoot(1.6)
    draw_a_zone(demo, film)
    change_the_swaths(demo, film)
    drive_and_compare(film)
    draw_the_curve(demo, film)
    content = film.webp()
    assert 18_000 <= sum(film.shown_ms) <= 26_000
    assert 100_000 < len(content) < LARGEST_BYTES
    save_picture("desk.webp", content)


def draw_a_zone(demo: DeskPage, film: Recorder) -> None:
    """Draw ground that no route may touch."""
    corners = demo.document["areas"][0][0]
    west, south = min(x for x, _ in corners), min(y for _, y in corners)
    film.click("[data-tool=no_go]")
    zone = [
        (west + 560, south + 330),
        (west + 790, south + 380),
        (west + 740, south + 570),
        (west + 540, south + 520),
    ]
    for place in (*zone, zone[0]):
        film.click_map(*place)
    demo.wait_for_revision(1)
    demo.wait_for_error()
    demo.page.wait_for_timeout(300)
    film.shoot(1.6)


def change_the_swaths(demo: DeskPage, film: Recorder) -> None:
    """Ask for more swaths."""
    film.click("#planner-swaths", 0.3)
    demo.fill("planner-swaths", "12")
    demo.wait_for_revision(2)
    demo.wait_for_error()
    demo.page.wait_for_timeout(300)
    film.shoot(1.6)


def drive_and_compare(film: Recorder) -> None:
    """Drive the plan in time, then compare the predicted error with the slope."""
    film.click("[aria-label^='The drive in time']")
    film.slide("#time", [50.0 + 75.0 * k for k in range(11)], 0.2)
    film.click("[aria-label^='The drive in time']", 0.3)
    film.click("#show-contours", 0.3)
    film.click("#swipe-on", 0.4)
    film.demo.page.select_option("#swipe-right", "slope")
    film.slide("#swipe", [0.55, 0.45, 0.35, 0.25, 0.35, 0.45], 0.25)
    film.click("#swipe-on", 0.2)
    film.demo.page.uncheck("#show-slope")


def draw_the_curve(demo: DeskPage, film: Recorder) -> None:
    """Compute the error against swaths, then show what else the panel holds."""
    film.click("#tab-compare", 0.6)
    film.click("#start-curve", 0.6)
    for n_points in (3, 6):
        demo.page.wait_for_selector(f"#page-compare tbody tr >> nth={n_points}")
        film.shoot(0.7)
    demo.page.wait_for_selector("#start-curve:not([disabled])")
    film.shoot(1.8)
    for tab in ("require", "runs", "measured", "files"):
        film.click(f"#tab-{tab}", 1.2)


LARGEST_STATE_BYTES = 80_000


def test_the_main_states_are_pictured(demo):
    demo.page.check("#show-contours")
    for name, arrange in STATES.items():
        demo.tab(name)
        arrange(demo)
        demo.page.mouse.move(430.0, 700.0)  # off the controls, whose help would be shown
        demo.page.wait_for_timeout(700)
        name_the_folder(demo)
        picture = Image.open(io.BytesIO(demo.page.screenshot())).convert("RGB")
        buffer = io.BytesIO()
        picture.resize((960, 570), Image.Resampling.LANCZOS).save(buffer, "WEBP", quality=60, method=6)
        assert 10_000 < len(buffer.getvalue()) <= LARGEST_STATE_BYTES
        save_picture(f"desk-{name}.webp", buffer.getvalue())
    assert demo.faults == []


def mark_points(demo: DeskPage) -> None:
    """Propose checkpoints, which lie on the map from then on."""
    demo.page.click("#page-shapes summary")
    demo.page.click("#propose-checkpoints")
    demo.wait_for(lambda: len(demo.document["checkpoints"]) > 0, "checkpoints")
    demo.wait_for_error()


def require_an_error(demo: DeskPage) -> None:
    """Ask for the cheapest plan that keeps an RMSE."""
    demo.fill("requirement-require", "2.5")
    demo.page.click("#start-guarantee")
    demo.page.wait_for_selector("#start-guarantee:not([disabled])")


def compare_plans(demo: DeskPage) -> None:
    """Draw the error against swaths."""
    demo.page.click("#start-curve")
    demo.page.wait_for_selector("#start-curve:not([disabled])")


def follow_a_drive(demo: DeskPage) -> None:
    """Follow the log of a drive along the swaths, and go back to the middle of its time."""
    workspace = demo.server.workspace
    with (workspace.folder / f"{workspace.name}.watch.jsonl").open("w", encoding="utf-8") as log:
        log.writelines(line_of(entry) for entry in driven_entries(workspace))
    demo.page.uncheck("#show-contours")
    demo.page.uncheck("#show-error")
    demo.page.click("#start-watch")
    demo.page.wait_for_selector("#watch-lines >> text=STOP")
    demo.page.uncheck("#show-watched-elevation")
    demo.page.locator("#watched").evaluate(
        "(slider) => { slider.value = 560; slider.dispatchEvent(new Event('input')); }"
    )


def close_the_drive(demo: DeskPage) -> None:
    """Take the drive off the map and show the predicted error again."""
    demo.page.evaluate("document.getElementById('watched-close').click()")
    demo.page.check("#show-error")


def driven_entries(workspace: Workspace) -> Iterator[dict]:
    """Yield the inputs of a watch: places of the plan's route with the heights of the terrain, a metre in a second."""
    plan = workspace.planner.exact(workspace.store.document).plan
    watch = SurveyWatch(plan.area, AdaptiveConfig(1.5, 0.95), list(plan.route.legs), every_m=250.0)
    yield watch_header(watch)
    xy = plan.route.sample(watch.config.sample_step_m, 0).xy
    along_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
    for time_s, (x, y), height in zip(along_m, xy, heights_at(workspace.tiles.pyramid, xy), strict=True):
        yield {"in": "sample", "sample": [time_s, x, y, height, 0.05, 1.0 - time_s / 20_000.0]}


STATES = {
    "settings": lambda _: None,
    "shapes": mark_points,
    "require": require_an_error,
    "compare": compare_plans,
    "runs": lambda _: None,
    "watch": follow_a_drive,
    "measured": close_the_drive,
    "files": lambda demo: demo.page.check("#show-slope"),
}
