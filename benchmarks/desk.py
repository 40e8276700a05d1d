"""How fast the planning desk follows: ``python -m benchmarks.desk``. Needs Chromium and playwright.

Limits are for CPU seconds, which a loaded machine does not change: of server and page until the page is ready, of the
computation from an edit to its route and errors, of the page for each frame of a pan.
On an idle machine they are the times that a user waits. Wall times and the load of the machine stand beside them for
information. The site of the edits is that of ``firnline desk --demo``, 1 km² with 8 swaths; the large terrain is drawn
with seed 1. Nothing was tuned on them. `desk_crowd` lets two desks write one plan, and many windows ask one desk; `desk_seen`
counts texts that are cut and boxes that overlap.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.desk_crowd import lost_edits, others_wait_s
from benchmarks.desk_seen import SIZES, faults, states
from benchmarks.report import Row, cpu_seconds, main
from desk.plan.document import PlanDocument
from desk.plan.live import LivePlan, plan_once
from desk.plan.summary import error_layer, plan_summary
from desk.workspace import Workspace, open_workspace, write_demo

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_COUNT = count()
_ROOT = Path(__file__).resolve().parents[1]
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
    """Yield address and process of a desk, and the time until it prints its address [s]."""
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


def process_cpu_s(process: int) -> float:
    """Return the CPU time that a process has taken [s]."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Page:
    """Page of a desk in a new context, with the CPU time of its thread and the addresses that it asked."""

    def __init__(self, browser: Any) -> None:
        self.page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
        self.page.set_default_timeout(300_000)
        self.asked: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self._session = self.page.context.new_cdp_session(self.page)
        self._session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def open(self, address: str) -> float:
        """Open the desk; return the wall time until it is ready [s]."""
        began = time.perf_counter()
        self.page.goto(address)
        self.page.wait_for_selector("html[data-ready]", state="attached")
        return time.perf_counter() - began

    def first_paint_s(self) -> float:
        """Return the time from the navigation to the first paint of content [s]."""
        name = "first-contentful-paint"
        return float(self.page.evaluate(f"performance.getEntriesByName('{name}')[0].startTime")) / 1000.0

    def cpu_s(self) -> float:
        """Return the CPU time of the page's thread [s]."""
        metrics = self._session.send("Performance.getMetrics")["metrics"]
        return float(next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration"))


def starts(browser: Any, folder: Path, n: int) -> Iterator[Row]:
    """Start the server and open its page, cold."""
    found: list[tuple[float, float, float, float, float]] = []
    outside = 0
    for _ in range(n):
        with running(folder, "--demo") as (address, process, server_s):
            page = Page(browser)
            page_s = page.open(address)
            server_cpu_s = process_cpu_s(process)
            found.append((server_cpu_s, page.cpu_s(), server_s, page_s, page.first_paint_s()))
            page.page.wait_for_selector("html[data-forms][data-error$='fine']", state="attached")
            outside += sum(
                not url.startswith((address.split("/?")[0], "data:", "blob:")) for url in page.asked
            )
            page.page.close()
    server_cpu_s, page_cpu_s, server_s, page_s, paint_s = np.median(found, axis=0)
    yield Row.of(f"server until the page is ready: CPU, median of {n}", float(server_cpu_s), "s", "<=", 2.0)
    yield Row.of("page ready, cold: CPU of the page, median", float(page_cpu_s), "s", "<=", 1.5)
    yield Row("address printed: wall time, median", float(server_s), "s")
    yield Row("page ready, cold: wall time, median", float(page_s), "s")
    yield Row.of(
        "first paint, start of the server included: wall time, median",
        float(server_s + paint_s),
        "s",
        "<=",
        1.0,
    )
    yield Row.of(
        "interactive, start of the server included: wall time, median",
        float(server_s + page_s),
        "s",
        "<=",
        1.5,
    )
    yield Row.of("requests to other hosts", outside, "", "<=", 0)


def edits(folder: Path, n: int) -> Iterator[Row]:
    """Change a setting, and move a corner, of the sample site; from the request to what the page is sent."""
    with open_workspace(write_demo(folder / "edits"), folder) as workspace:
        plan_once()  # as the server does while the page is opened
        first = workspace.store.document
        workspace.planner.exact(first)
        settings = [_followed(workspace, _with_swaths(first, 8 + k % 2)) for k in range(-n, 0)]
        moves = [_followed(workspace, _with_corner(first, 3.0 * (k + 1))) for k in range(n)]
        for what, found in (("setting", settings), ("corner", moves)):
            route_s, coarse_s, fine_s = np.percentile(found, 95, axis=0)
            yield Row(f"{what} changed: route, CPU, p95 of {n}", float(route_s), "s")
            yield Row.of(f"{what} changed: route and coarse error, CPU, p95", float(coarse_s), "s", "<=", 0.3)
            yield Row.of(f"{what} changed: route and fine error, CPU, p95", float(fine_s), "s", "<=", 1.0)
        _, fitted_s = cpu_seconds(lambda: workspace.planner.exact(workspace.store.document))
        yield Row.of("covariance of a new outline, CPU", fitted_s, "s", "<=", 0.5)


def _followed(workspace: Workspace, document: PlanDocument) -> tuple[float, float, float]:
    """Store an edit; return the CPU time until its route, its coarse and its fine error are ready [s]."""
    store = workspace.store

    def route() -> LivePlan:
        store.edit(store.revision, "Edit", document)
        live = workspace.planner.quick(document)
        json.dumps(plan_summary(live, document, workspace.name, workspace.terrain.name))
        return live

    live, route_s = cpu_seconds(route)
    _, coarse_s = cpu_seconds(lambda: json.dumps(error_layer(live.plan, "coarse")))
    _, fine_s = cpu_seconds(lambda: json.dumps(error_layer(live.plan, "fine")))
    return route_s, route_s + coarse_s, route_s + coarse_s + fine_s


def _with_swaths(document: PlanDocument, swaths: int) -> PlanDocument:
    inset = 0.3 + next(_COUNT) * 1e-4  # differs each time, so that no plan comes from the cache
    return document.model_copy(
        update={"planner": {"pattern": "lawnmower", "swaths": swaths, "inset_share": inset}}
    )


def _with_corner(document: PlanDocument, metres: float) -> PlanDocument:
    """Return the document with its first corner moved outwards."""
    ((x, y), *others), *holes = document.areas[0]
    return document.model_copy(update={"areas": ((((x + metres, y - metres), *others), *holes),)})


def many_corners(folder: Path, n_corners: int, n_steps: int, n: int) -> Iterator[Row]:
    """Move corners of an outline of many after many edits."""
    with open_workspace(write_demo(folder / "many"), folder) as workspace:
        store = workspace.store
        outline = np.array(store.document.areas[0][0])
        angle = np.linspace(0.0, 2.0 * np.pi, n_corners, endpoint=False)
        radius_m = (
            0.45 * np.ptp(outline[:, 0]) * (1.0 + 0.04 * np.sin(9.0 * angle) + 0.001 * np.sin(997.0 * angle))
        )
        xy = outline.mean(axis=0) + radius_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        ring, middle = tuple(map(tuple, xy.round(3).tolist())), tuple(outline.mean(axis=0).tolist())
        store.edit(0, "Draw", store.document.model_copy(update={"areas": ((ring,),), "starts": (middle,)}))
        workspace.planner.exact(store.document)
        for _ in range(n_steps):
            store.edit(store.revision, "Move a corner", _with_corner(store.document, 0.01))
        stored = [
            cpu_seconds(lambda: store.edit(store.revision, "Move", _with_corner(store.document, 0.01)))[1]
            for _ in range(n)
        ]
        followed = [_followed(workspace, _with_corner(store.document, 0.3)) for _ in range(n)]
        what = f"{n_corners} corners after {n_steps} edits"
        yield Row.of(
            f"{what}: edit stored, CPU, p95 of {n}", float(np.percentile(stored, 95)), "s", "<=", 0.1
        )
        route_s, coarse_s, fine_s = np.percentile(followed, 95, axis=0)
        yield Row(f"{what}: route, CPU, p95", float(route_s), "s")
        yield Row.of(f"{what}: route and coarse error, CPU, p95", float(coarse_s), "s", "<=", 0.5)
        yield Row.of(f"{what}: route and fine error, CPU, p95", float(fine_s), "s", "<=", 1.0)
        yield Row(f"{what}: size of the plan's file", store.path.stat().st_size / 1e6, "MB")


def crowd(folder: Path, n_edits: int, n_kills: int) -> Iterator[Row]:
    """Edit one plan from two desks that are killed, and ask one desk from many windows."""
    n_stored, n_lost = lost_edits(folder / "crowd.desk.json", n_edits, n_kills)
    yield Row(f"two desks on one plan, {n_kills} killed: edits that were stored", n_stored, "")
    yield Row.of("two desks on one plan: edits lost or overwritten unseen", n_lost, "", "<=", 0)
    with running(folder, "--demo") as (address, _, _):
        log = folder / "firnline-desk-demo" / "srtm_sample.watch.jsonl"
        wait_s, wrong = others_wait_s(address, log, 50)
        yield Row.of(
            "50 clients, 50 streams, 50 unfinished requests: answer, wall, p95", wait_s, "s", "<=", 1.0
        )
        yield Row.of("kinds of request among them that were answered wrongly", len(wrong), "", "<=", 0)


def seen(browser: Any, folder: Path, sizes: Sequence[tuple[int, int]]) -> Iterator[Row]:
    """Count texts that are cut and boxes that overlap in the states of the page, with long names in the data."""
    found: list[str] = []
    for width, height in sizes:
        place = folder / f"seen-{width}"
        place.mkdir()
        with running(place, "--demo") as (address, _, _):
            page = Page(browser)
            page.page.set_viewport_size({"width": width, "height": height})
            page.open(address)
            page.page.wait_for_selector("html[data-forms][data-error$='fine']", state="attached")
            raster = place / "firnline-desk-demo" / "srtm_sample.tif"
            found += [
                f"{width} {state} {fault}"
                for state in states(page.page, raster)
                for fault in faults(page.page)
            ]
            page.page.close()
    for fault in found:
        print(fault, file=sys.stderr)
    yield Row.of(
        f"texts cut and boxes overlapping, 8 states on {len(sizes)} screens", len(found), "", "<=", 0
    )


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
        yield Row(f"address of {side**2:.0e} cells printed: wall time", ready_s, "s")
        page = Page(browser)
        yield Row("its page ready, cold: wall time", page.open(address), "s")
        per_cpu_s, per_s = [], []
        for resolution in (8.0, 2.0, 1.0):
            page.page.evaluate(f"globalThis.firnlineDesk.map.getView().setResolution({resolution})")
            page.page.wait_for_timeout(2000)
            before = page.cpu_s()
            times = page.page.evaluate(_PAN, 4.0)
            per_cpu_s.append(len(times) / (page.cpu_s() - before))
            per_s.append((len(times) - 1) / (times[-1] - times[0]) * 1000.0)
        cells = f"{side**2:.0e} cells"
        yield Row.of(
            f"pan over {cells}, slowest of three zooms: frames for each CPU second of the page",
            min(per_cpu_s),
            "1/s",
            ">=",
            20.0,
        )
        yield Row(f"pan over {cells}, slowest of three zooms: frames for each second", min(per_s), "1/s")
        yield Row.of(f"peak memory of the server of {cells}", peak_mb(process), "MB", "<=", 1000.0)
        page.page.close()


def rows(quick: bool) -> Iterator[Row]:
    from playwright.sync_api import sync_playwright

    n_starts, n_edits, side = (1, 6, 3000) if quick else (3, 20, 10_000)
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        yield Row("load of the machine, mean of the last minute at the begin", os.getloadavg()[0], "")
        yield from edits(folder, n_edits)
        yield from many_corners(folder, *((2_000, 20, 3) if quick else (20_000, 200, 20)))
        yield from crowd(folder, *((60, 2) if quick else (1_000, 20)))
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield from starts(browser, folder, n_starts)
        yield from seen(browser, folder, SIZES[:1] if quick else SIZES)
        yield from panning(browser, folder, side)
        browser.close()
        yield Row("load of the machine, mean of the last minute at the end", os.getloadavg()[0], "")


if __name__ == "__main__":
    main("Desk", rows, ("starlette", "uvicorn", "playwright"))
