"""Access: axe on each view, dark mode, a phone, a page of somebody else."""

import http.server
import threading

import pytest

from tests.accessibility import violations
from tests.desk.browser.conftest import DeskPage

pytestmark = pytest.mark.walkthrough

VIEWS = ("settings", "shapes", "require", "compare", "runs", "measured", "files")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("view", VIEWS)
def test_axe_finds_nothing(opened, view, scheme):
    opened.page.emulate_media(color_scheme=scheme)
    opened.wait_for_error()
    opened.tab(view)
    if view == "compare":
        opened.page.click("#start-curve")
        opened.page.wait_for_selector("[aria-label='Use 8 swaths']")
        opened.page.fill("#variant-name", "four")
        opened.page.click("#add-variant")
        opened.page.wait_for_selector("#variants >> text=four")
    opened.page.wait_for_timeout(250)
    assert violations(opened.page) == []


def test_axe_finds_nothing_on_refusals_and_profiles(opened):
    opened.wait_for_error()
    opened.page.click("[aria-label^='The drive in time']")
    opened.page.wait_for_selector("#drive .curve")
    opened.page.check("#swipe-on")
    assert violations(opened.page) == []
    opened.fill("planner-swaths", "-3")
    opened.page.wait_for_selector("#refusal:not([hidden])")
    assert violations(opened.page) == []


def test_a_phone_shows_map_and_numbers_without_scrolling_sideways(browser, server):
    context = browser.new_context(viewport={"width": 390, "height": 800}, has_touch=True)
    phone = DeskPage(context, server).open()
    phone.wait_for_error()
    assert phone.page.evaluate("document.documentElement.scrollWidth") <= 390
    assert phone.page.locator("#map").bounding_box()["height"] > 300
    assert phone.page.is_visible("#rmse")
    assert violations(phone.page) == []
    context.close()


def test_every_control_is_reached_by_the_tab_key(opened):
    page = opened.page
    reached = set()
    page.focus("#map")
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate(
                "document.activeElement.id || document.activeElement.dataset.tool || document.activeElement.getAttribute('aria-label')"
            )
        )
    assert {
        "area",
        "no_go",
        "start",
        "Zoom in",
        "show-relief",
        "tab-settings",
        "planner-pattern",
        "planner-swaths",
    } <= reached


class _Hostile(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>other</title><p>A page of somebody else")

    def log_message(self, *_):
        pass


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_a_hostile_page_in_another_tab_can_do_nothing(opened, host):
    other = http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Hostile)
    threading.Thread(target=other.serve_forever, daemon=True).start()
    page = opened.page.context.new_page()
    page.goto(f"http://{host}:{other.server_port}/")
    target = opened.server.origin
    attempt = """async ([target]) => {
        const tried = async (f) => { try { return await f(); } catch (error) { return "blocked"; } };
        const events = await new Promise((done) => { const s = new EventSource(target + "/api/jobs/x/events"); s.onopen = () => done("open"); s.onerror = () => done("blocked"); });
        const image = await new Promise((done) => { const i = new Image(); i.onload = () => done("loaded"); i.onerror = () => done("blocked"); i.src = target + "/tiles/relief/0/0/0.png"; });
        const socket = await new Promise((done) => { const s = new WebSocket(target.replace("http", "ws") + "/"); s.onopen = () => done("open"); s.onerror = () => done("blocked"); });
        return [
            await tried(async () => (await fetch(target + "/api/plan", { credentials: "include" })).text()),
            await tried(async () => (await fetch(target + "/api/edit", { method: "POST", credentials: "include", body: "{}" })).text()),
            events, image, socket];
    }"""
    assert page.evaluate(attempt, [target]) == ["blocked"] * 5
    page.evaluate(
        "(target) => fetch(target + '/api/undo', { method: 'POST', mode: 'no-cors', credentials: 'include', body: '{\"revision\": 0}' }).catch(() => null)",
        target,
    )
    form = "(target) => { document.body.innerHTML = `<form method=post enctype=text/plain action='${target}/api/undo'><input name='{\"revision\":0,\"x\":\"' value='\"}'></form>`; document.forms[0].submit(); }"
    page.evaluate(form, target)
    page.wait_for_timeout(300)
    assert opened.server.workspace.store.revision == 0
    other.shutdown()
    other.server_close()
