"""A small site for the desk: hills of 20 × 20 cells of 45 m, and its application behind a gate."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import anyio
import httpx
import numpy as np
import pytest
import uvicorn

from desk.plan.document import PlanDocument
from desk.server.gate import Gate
from desk.server.serve import Opened, Opening, _listener, _load_planners, desk_app, server_config
from desk.workspace import Workspace
from planners.planning import prior_model
from planners.prediction.assumptions import MapAssumptions
from planners.prediction.error_model import ErrorModel
from survey import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid

PORT = 8765
HOST = f"127.0.0.1:{PORT}"
ORIGIN = {"origin": f"http://{HOST}"}
WEST, SOUTH = 500_000.0, 6_700_000.0
SQUARE = (
    (WEST + 200.0, SOUTH + 200.0),
    (WEST + 700.0, SOUTH + 200.0),
    (WEST + 700.0, SOUTH + 700.0),
    (WEST + 200.0, SOUTH + 700.0),
)


FITTED: dict[tuple[object, ...], ErrorModel | None] = {}


def hills() -> Dem:
    """Return smooth hills; one corner is unknown."""
    grid = Grid((WEST + 22.5, SOUTH + 22.5, WEST + 877.5, SOUTH + 877.5), 45.0, "EPSG:32608")
    x, y = np.meshgrid(np.arange(grid.shape[1]) * 45.0, np.arange(grid.shape[0]) * 45.0)
    heights = 800.0 + 20.0 * np.sin(x / 140.0) + 15.0 * np.cos(y / 110.0 + x / 300.0)
    heights[:2, :2] = np.nan
    return Dem.on(grid, heights)


@pytest.fixture(scope="module", autouse=True)
def models_once() -> Iterator[None]:
    """Fit the covariance of an outline once for all desks: that of equal outlines over equal elevations is equal."""

    def model_once(prior: Dem, area: SurveyArea, assumed: MapAssumptions | None = None) -> ErrorModel | None:
        key = (prior.bounds, prior.elevation.tobytes(), area.free.wkb, area.crs, assumed)
        if key not in FITTED:
            FITTED[key] = prior_model(prior, area, assumed)
        return FITTED[key]

    # No test elsewhere may see it.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planners.prior_model", model_once)
        yield


@pytest.fixture(scope="session")
def dem_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raster of the hills."""
    file = tmp_path_factory.mktemp("terrain") / "hills.tif"
    hills().write(file)
    return file


@pytest.fixture
def workspace(dem_file: Path, tmp_path: Path) -> Iterator[Workspace]:
    """Workspace with a square drawn."""
    document = PlanDocument(areas=((SQUARE,),), planner={"pattern": "lawnmower", "swaths": 4})
    with Workspace(dem_file, tmp_path / "hills.desk.json", document) as opened:
        yield opened


@pytest.fixture
def gate(workspace: Workspace) -> Gate:
    """Application behind its gate."""
    return Gate(desk_app(workspace), PORT)


class Visitor:
    """Client without a session; its calls are synchronous."""

    def __init__(self, gate: Gate) -> None:
        self._gate = gate
        self._cookies = httpx.Cookies()

    def get(self, path: str, **headers: str) -> httpx.Response:
        return self.ask("GET", path, headers=headers)

    def post(self, path: str, content: object, **headers: str) -> httpx.Response:
        body = {"content": content} if isinstance(content, bytes) else {"json": content}
        return self.ask("POST", path, headers={**ORIGIN, **headers}, **body)

    def delete(self, path: str) -> httpx.Response:
        return self.ask("DELETE", path, headers=ORIGIN)

    def ask(self, method: str, path: str, **options: object) -> httpx.Response:
        async def ask() -> httpx.Response:
            transport = httpx.ASGITransport(app=self._gate, raise_app_exceptions=False)
            async with httpx.AsyncClient(
                transport=transport, base_url=f"http://{HOST}", cookies=self._cookies
            ) as client:
                answer = await client.request(method, path, **options)  # type: ignore[arg-type]
                self._cookies = client.cookies
                return answer

        return anyio.run(ask)


class Page(Visitor):
    """Client with a session, as the page of the desk is one."""

    def __init__(self, gate: Gate) -> None:
        super().__init__(gate)
        assert self.get(gate.address.removeprefix(f"http://{HOST}")).status_code == 200


@pytest.fixture
def visitor(gate: Gate) -> Visitor:
    """Client of somebody else."""
    return Visitor(gate)


@pytest.fixture
def page(gate: Gate) -> Page:
    """Client of the page."""
    return Page(gate)


class DeskServer:
    """Server of a workspace in a thread of its own."""

    def __init__(self, workspace: Workspace, images_from: str = "") -> None:
        listener = _listener(0)
        self.workspace = workspace
        opening = Opening()
        opening.opened.set_result(Opened(workspace, desk_app(workspace), lambda _: None))
        _load_planners(opening.loaded)
        self.gate = Gate(opening, listener.getsockname()[1], images_from)
        self._server = uvicorn.Server(server_config(self.gate))
        self._thread = threading.Thread(target=lambda: self._server.run(sockets=[listener]), daemon=True)
        self._thread.start()
        while not self._server.started:
            time.sleep(0.01)

    @property
    def origin(self) -> str:
        """Address of the page without the token."""
        return self.gate.address.split("/?")[0]

    def stop(self) -> None:
        """End the server."""
        self._server.should_exit = True
        self._thread.join(10.0)


@pytest.fixture
def server(workspace: Workspace) -> Iterator[DeskServer]:
    """Server of the small site."""
    running = DeskServer(workspace)
    yield running
    running.stop()
