"""A real server and a real browser: Debian's Chromium, driven by playwright."""

import time
from collections.abc import Callable, Iterator

import pytest

from tests.desk.conftest import DeskServer

WAIT_MS = 120_000  # loaded machines are slow


class DeskPage:
    """The page of a desk in the browser, with what tests do on it."""

    def __init__(self, context, server: DeskServer) -> None:
        self.server = server
        self.requests: list[str] = []
        self.faults: list[str] = []
        self.page = context.new_page()
        self.page.set_default_timeout(WAIT_MS)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("response", lambda answer: answer.status >= 400 and self.faults.append(answer.url))
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on(
            "console",
            lambda message: (
                message.type == "error" and self.faults.append(f"{message.text} {message.location}")
            ),
        )

    def open(self, address: str | None = None) -> "DeskPage":
        """Open the page and wait until it can be used."""
        self.page.goto(address or self.server.gate.address)
        self.page.wait_for_selector("html[data-forms]", state="attached")
        return self

    @property
    def document(self) -> dict:
        """The document that the server has stored."""
        return self.server.workspace.store.document.model_dump(mode="json")

    def wait_for(self, condition: Callable[[], bool], what: str = "condition") -> None:
        """Wait until something holds."""
        until = time.monotonic() + WAIT_MS / 1000
        while not condition():
            assert time.monotonic() < until, f"waited in vain for the {what}"
            self.page.wait_for_timeout(20)

    def wait_for_revision(self, revision: int) -> None:
        """Wait until an edit is stored."""
        self.wait_for(lambda: self.server.workspace.store.revision >= revision, f"revision {revision}")

    def wait_for_error(self) -> None:
        """Wait until the error of the document as it stands is shown in detail."""
        self.wait_for(
            lambda: (self.state("error") or "") == f"{self.server.workspace.store.revision} fine", "error"
        )

    def wait_until(self, expression: str) -> None:
        """Wait until an expression of the page holds; the page's policy forbids playwright's own way."""
        self.wait_for(lambda: bool(self.page.evaluate(expression)), expression)

    def state(self, name: str) -> str | None:
        """Return a state of the page."""
        return self.page.evaluate(f"document.documentElement.dataset.{name}")

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return where a place of the map is on the screen."""
        return tuple(self.page.evaluate("([x, y]) => globalThis.firnlineDesk.pixelOf(x, y)", [x, y]))

    def click(self, x: float, y: float, *, double: bool = False) -> None:
        """Click a place of the map."""
        place = self.pixel(x, y)
        self.page.mouse.move(*place)
        (self.page.mouse.dblclick if double else self.page.mouse.click)(*place)
        self.page.wait_for_timeout(30)

    def draw(self, tool: str, places: list[tuple[float, float]]) -> None:
        """Draw a polygon with the mouse."""
        self.page.click(f"[data-tool={tool}]")
        for place in places:
            self.click(*place)
        self.click(*places[0])

    def zoom_out(self) -> None:
        """Zoom out, and wait until the map stands still."""
        before = self.page.evaluate("globalThis.firnlineDesk.resolution()")
        self.page.click("[aria-label='Zoom out']")
        self.wait_until(f"globalThis.firnlineDesk.resolution() > {1.5 * before}")
        self.page.wait_for_timeout(250)

    def tab(self, name: str) -> None:
        """Open a tab of the panel."""
        self.page.click(f"#tab-{name}")

    def fill(self, field: str, value: str) -> None:
        """Type into a field and leave it."""
        self.page.fill(f"#{field}", value)
        self.page.press(f"#{field}", "Tab")


@pytest.fixture
def opened(browser, server: DeskServer) -> Iterator[DeskPage]:
    """The page, open on the small site."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
    yield DeskPage(context, server).open()
    context.close()
