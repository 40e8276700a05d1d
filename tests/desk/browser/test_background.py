"""The background of the map in a browser: dropped pictures, and a map service of which the page asks one host alone."""

import io
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import ClassVar

import numpy as np
import pytest
from PIL import Image

from desk.terrain.background import open_background
from tests.desk.browser.conftest import DeskPage
from tests.desk.conftest import SOUTH, WEST, DeskServer
from tests.desk.terrain.test_background import BOUNDS, halves, write_picture

pytestmark = [pytest.mark.walkthrough, pytest.mark.timeout(600)]
PLACE = (WEST + 300.0, SOUTH + 450.0)


class Tiles(BaseHTTPRequestHandler):
    """Map service of green tiles that remembers what was asked."""

    asked: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.asked.append(self.path)
        buffer = io.BytesIO()
        Image.new("RGB", (256, 256), (10, 200, 30)).save(buffer, "PNG")
        self.send_response(200)
        self.end_headers()
        self.wfile.write(buffer.getvalue())

    def log_message(self, *_: object) -> None:
        """Write no log."""


@pytest.fixture
def service() -> Iterator[str]:
    """Address of a map service on this machine."""
    Tiles.asked = []
    running = ThreadingHTTPServer(("127.0.0.1", 0), Tiles)
    threading.Thread(target=running.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{running.server_port}"
    running.shutdown()
    running.server_close()


def is_seen(opened: DeskPage, place: tuple[float, float], colour: tuple[int, int, int]) -> bool:
    """Return whether a place of the map has a colour; the area over it has a faint one of its own."""
    x, y = opened.pixel(*place)
    picture = Image.open(io.BytesIO(opened.page.screenshot())).convert("RGB")
    return bool(np.abs(np.subtract(picture.getpixel((round(x), round(y))), colour)).max() < 8)


def show_alone(opened: DeskPage) -> None:
    """Hide what lies over the background."""
    for name in ("error", "route", "relief"):
        opened.page.uncheck(f"#show-{name}")
    opened.page.wait_for_selector("#show-background")


def test_a_dropped_picture_lies_on_the_map_with_its_opacity(opened, tmp_path):
    opened.page.set_input_files("#open-file", write_picture(tmp_path / "ortho.tif", halves(), "EPSG:4326"))
    show_alone(opened)
    opened.wait_for(lambda: is_seen(opened, PLACE, (200, 0, 0)), "picture")
    assert is_seen(opened, (WEST + 600.0, SOUTH + 460.0), (0, 0, 200))
    opened.page.locator("[aria-label^='Opacity of Background']").evaluate(
        "(slider) => { slider.value = 0.5; slider.dispatchEvent(new Event('input')); }"
    )
    opened.wait_for(lambda: is_seen(opened, PLACE, (216, 119, 121)), "half of the picture")
    opened.page.reload()
    opened.page.wait_for_selector("#show-background")
    assert opened.faults == []


@pytest.mark.parametrize(("answer", "layer"), [("elevations", "dropped-1"), ("picture", "background")])
def test_a_raster_of_one_band_is_asked_about(opened, dem_file, answer, layer):
    opened.page.set_input_files("#open-file", dem_file)
    opened.page.click(f"#raster-kind button[value={answer}]")
    opened.page.wait_for_selector(f"#show-{layer}")


def test_no_host_but_the_named_one_is_asked(browser, workspace, service):
    tiles = workspace.tiles
    tiles.background = open_background(f"{service}/{{z}}/{{x}}/{{y}}.png", workspace.crs, BOUNDS)
    server, context = DeskServer(workspace, service), browser.new_context()
    opened = DeskPage(context, server).open()
    show_alone(opened)
    opened.wait_for(lambda: is_seen(opened, PLACE, (10, 200, 30)), "tiles")
    assert Tiles.asked
    allowed = (server.origin, service, "data:", "blob:")
    assert [url for url in opened.requests if not url.startswith(allowed)] == []
    blocked = opened.page.evaluate(
        """() => new Promise((done) => {
          const picture = new Image();
          picture.onerror = () => done(true);
          picture.onload = () => done(false);
          picture.src = "http://localhost:1/a.png";
        })"""
    )
    assert blocked
    assert any("Content Security Policy" in fault for fault in opened.faults)
    context.close()
    server.stop()
