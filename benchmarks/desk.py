"""How fast the planning desk follows: ``python -m benchmarks.desk``. Needs Chromium and playwright.

Times are wall times as a user sees them, of a real server and a real browser. The site of the edits is the sample
site of ``firnline desk --demo``, 1 km² with 8 swaths; the large terrain is drawn with seed 1. Nothing was tuned on them.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Row, main

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_ROOT = Path(__file__).resolve().parents[1]
_WATCH = """() => {
  const log = (globalThis.deskLog = []);
  const state = document.documentElement.dataset;
  new MutationObserver(() => log.push([performance.now(), state.route ?? "", state.error ?? ""]))
    .observe(document.documentElement, { attributes: true });
  addEventListener("pointerup", () => log.push([performance.now(), "up", ""]), true);
  addEventListener("change", () => log.push([performance.now(), "up", ""]), true);
}"""
_PAN = """(seconds) => new Promise((done) => {
  const { map } = globalThis.firnlineDesk, view = map.getView(), [x, y] = view.getCenter();
  const reach = 500 * view.getResolution(), times = [];
  const began = performance.now();
  const step = () => {
    const now = performance.now(), share = (now - began) / (1000 * seconds);
    times.push(now);
    view.setCenter([x + reach * Math.sin(6.28 * share) * 3, y + reach * (1 - Math.cos(6.28 * share)) * 3]);
    map.renderSync();
    if (share < 1) requestAnimationFrame(step);
    else done(times);
  };
  step();
})"""


@contextmanager
def running(folder: Path, *arguments: str) -> Iterator[tuple[str, int, float]]:
    """Yield address and process of a desk, and the time until it answers [s]."""
    command = [sys.executable, "-m", "firnline", "desk", *arguments, "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": str(_ROOT), "PYTHONUNBUFFERED": "1"}
    began = time.perf_counter()
    with subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = re.search(r"http\S+", str(server.stdout and server.stdout.readline()))
            if address is None:
                raise RuntimeError("the desk did not start")
            yield address[0], server.pid, time.perf_counter() - began
        finally:
            server.terminate()


def opened(browser: Any, address: str) -> tuple[Any, float, list[str]]:
    """Return a page in a new context, the time until it is ready [s], and the addresses that it asked."""
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.set_default_timeout(120_000)
    began = time.perf_counter()
    page.goto(address)
    page.wait_for_selector("html[data-ready]", state="attached")
    return page, time.perf_counter() - began, asked


def settled(page: Any) -> None:
    """Wait until the error of the outline as it stands is shown."""
    page.wait_for_selector("html[data-forms][data-error$='fine']:not([data-busy])", state="attached")


def followed_s(page: Any, act: Any) -> dict[str, float]:
    """Do something, and return after what time its route and its errors were shown [s]."""
    page.evaluate("() => { globalThis.deskLog.length = 0; }")
    before = page.get_attribute("html", "data-route")
    act()
    page.wait_for_selector(f"html:not([data-route^='{(before or '').rstrip('~')}'])", state="attached")
    settled(page)
    log = page.evaluate("() => globalThis.deskLog")
    began = next(at for at, route, _ in log if route == "up")
    revision = log[-1][1].rstrip("~")
    shown = {}
    for at, route, error in log:
        if route.rstrip("~") == revision:
            shown.setdefault("route", at)
        for detail in ("coarse", "fine"):
            if error.rstrip("~") == f"{revision} {detail}":
                shown.setdefault(detail, at)
                shown[f"last {detail}"] = at
    return {name: (at - began) / 1000.0 for name, at in shown.items()}


def edits(page: Any, n: int) -> Iterator[Row]:
    """Set the number of swaths, and move a corner with the mouse."""
    page.evaluate(_WATCH)
    settings, corners = [], []
    for k in range(n):
        settings.append(followed_s(page, lambda k=k: _typed(page, 7 + k % 2)))
    _typed(page, 8)
    settled(page)
    for k in range(n):
        corners.append(followed_s(page, lambda k=k: _dragged(page, 24 if k % 2 else -24)))
    for what, found in (("setting", settings), ("corner", corners)):
        route, coarse, fine = (
            np.percentile([one[name] for one in found], 95) for name in ("route", "coarse", "fine")
        )
        yield Row(f"{what} changed: route shown, p95 of {n}", float(route), "s")
        yield Row.of(f"{what} changed: coarse error shown, p95", coarse, "s", "<=", 0.3)
        yield Row.of(f"{what} changed: fine error shown, p95", fine, "s", "<=", 1.0)
    exact = np.percentile([one["last fine"] for one in corners], 95)
    yield Row("corner changed: error with the covariance of the new outline, p95", float(exact), "s")


def _typed(page: Any, swaths: int) -> None:
    page.fill("#planner-swaths", str(swaths))
    page.press("#planner-swaths", "Tab")


def _dragged(page: Any, pixels: float) -> None:
    """Move the north-western corner of the area to the east or west."""
    corner = "(() => { const d = globalThis.firnlineDesk; return d.pixelOf(...d.corner()); })()"
    x, y = page.evaluate(corner)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + pixels, y, steps=3)
    page.mouse.up()


def large_terrain(file: Path, side: int) -> None:
    """Write smooth hills of side × side cells of a metre, in tiles without overviews."""
    import rasterio
    from rasterio.transform import from_origin

    rng = np.random.default_rng(1)
    waves = rng.normal(size=(6, 4))
    x = np.arange(side, dtype=np.float32) / 900.0
    profile = {
        "driver": "GTiff",
        "dtype": "float32",
        "count": 1,
        "width": side,
        "height": side,
        "crs": "EPSG:32608",
    }
    options = {"tiled": True, "blockxsize": 512, "blockysize": 512, "compress": "deflate", "nodata": -9999.0}
    with rasterio.open(
        file, "w", **profile, **options, transform=from_origin(500_000.0, 6_710_000.0, 1.0, 1.0)
    ) as target:
        for first in range(0, side, 512):
            y = np.arange(first, min(first + 512, side), dtype=np.float32)[:, None] / 900.0
            heights = sum(30 * np.sin(a * x + b * y + c) * np.cos(d * y) for a, b, c, d in waves) + 900.0
            window = rasterio.windows.Window(0, first, side, len(y))
            target.write(np.round(np.asarray(heights, dtype=np.float32), 2), 1, window=window)


def peak_mb(process: int) -> float:
    """Return the largest resident memory of a process [MB]."""
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    return int(re.findall(r"VmHWM:\s+(\d+)", status)[0]) * 1024 / 1e6


def panning(browser: Any, folder: Path, side: int) -> Iterator[Row]:
    """Pan over a large terrain at three widths of a cell."""
    large_terrain(folder / "large.tif", side)
    with running(folder, "large.tif") as (address, process, ready_s):
        yield Row(f"server of {side**2:.0e} cells ready", ready_s, "s")
        page, seconds, _ = opened(browser, address)
        yield Row("its page ready, cold", seconds, "s")
        slowest = []
        for resolution in (8.0, 2.0, 1.0):
            page.evaluate(f"globalThis.firnlineDesk.map.getView().setResolution({resolution})")
            page.wait_for_timeout(1500)
            times = np.diff(page.evaluate(_PAN, 4.0))
            slowest.append(1000.0 / float(np.mean(times)))
        yield Row.of(
            f"pan over {side**2:.0e} cells, slowest of three zooms", min(slowest), "frames/s", ">=", 20.0
        )
        yield Row.of(
            f"peak memory of the server of {side**2:.0e} cells", peak_mb(process), "MB", "<=", 1000.0
        )
        page.close()


def rows(quick: bool) -> Iterator[Row]:
    from playwright.sync_api import sync_playwright

    n_starts, n_edits, side = (1, 6, 3000) if quick else (5, 20, 10_000)
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as place:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        starts, pages, outside = [], [], 0
        for k in range(n_starts):
            with running(Path(place), "--demo") as (address, _, seconds):
                starts.append(seconds)
                page, page_s, asked = opened(browser, address)
                pages.append(page_s)
                if k == n_starts - 1:
                    settled(page)
                    yield Row.of(
                        f"server ready, median of {n_starts}", float(np.median(starts)), "s", "<=", 2.0
                    )
                    yield Row.of("page ready, cold, median", float(np.median(pages)), "s", "<=", 1.5)
                    yield from edits(page, n_edits)
                    origin = address.split("/?")[0]
                    outside = sum(not url.startswith((origin, "data:", "blob:")) for url in asked)
                page.close()
        yield Row.of("requests to other hosts", outside, "", "<=", 0)
        yield from panning(browser, Path(place), side)
        browser.close()


if __name__ == "__main__":
    main("Desk", rows, ("starlette", "uvicorn", "playwright"))
