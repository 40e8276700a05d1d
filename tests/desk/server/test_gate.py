"""The gate lets only the page of this server ask."""

import anyio
import pytest

from desk.server.gate import LARGEST_BODY_BYTES
from tests.desk.conftest import HOST, ORIGIN

READING = ("/", "/api/site", "/api/plan", "/static/js/main.js", "/tiles/relief/0/0/0.png")
WRITING = ("/api/edit", "/api/undo", "/api/redo")


@pytest.mark.parametrize("path", READING)
def test_without_a_session_nothing_is_shown(visitor, path):
    assert visitor.get(path).status_code == 401


@pytest.mark.parametrize("path", WRITING)
def test_without_a_session_nothing_is_changed(visitor, path):
    assert visitor.post(path, {}).status_code == 401


def test_the_token_opens_one_session_only(gate, visitor, page):
    address = gate.address.removeprefix(f"http://{HOST}")
    assert page.get("/api/plan").status_code == 200
    assert visitor.get(address).status_code == 401
    assert visitor.get("/?token=None").status_code == 401
    assert visitor.get("/?token=%00%ff").status_code == 401


def test_a_wrong_token_does_not_use_up_the_right_one(gate, visitor):
    assert visitor.get("/?token=wrong").status_code == 401
    answer = visitor.get(gate.address.removeprefix(f"http://{HOST}"))
    assert answer.status_code == 200
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert "Path=/" in cookie


@pytest.mark.parametrize(
    "host", ["evil.example", "localhost:8765", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8765.evil.example", ""]
)
def test_another_host_is_refused_as_in_dns_rebinding(page, host):
    assert page.get("/api/plan", host=host).status_code == 421


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "http://127.0.0.1:8766",
        "https://127.0.0.1:8765",
        "http://localhost:8765",
    ],
)
@pytest.mark.parametrize("path", WRITING)
def test_another_origin_changes_nothing(page, workspace, origin, path):
    assert page.post(path, {"revision": 0}, origin=origin).status_code == 403
    assert workspace.store.revision == 0


def test_a_request_that_changes_something_states_its_origin(page):
    assert page.ask("POST", "/api/undo", json={"revision": 0}).status_code == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
@pytest.mark.parametrize("path", READING)
def test_another_page_reads_nothing(page, site, path):
    # A page on another port of 127.0.0.1 is of the same site, so that the cookie alone would not stop it.
    assert page.get(path, **{"sec-fetch-site": site}).status_code == 403


def test_another_origin_reads_nothing(page):
    assert page.get("/api/plan", origin="http://evil.example").status_code == 403


@pytest.mark.parametrize("method", ["PUT", "PATCH", "OPTIONS", "TRACE", "CONNECT"])
def test_other_methods_are_refused(page, method):
    assert page.ask(method, "/api/plan", headers=ORIGIN).status_code == 405


def test_a_session_of_another_desk_is_refused(visitor):
    assert visitor.get("/api/plan", cookie="firnline_desk_8765=guess").status_code == 401
    assert visitor.get("/api/plan", cookie="\x01;;==").status_code == 401


def test_a_large_body_is_refused_by_its_header(page):
    answer = page.ask(
        "POST", "/api/edit", headers={**ORIGIN, "content-length": str(LARGEST_BODY_BYTES + 1)}, content=b"{}"
    )
    assert answer.status_code == 413


def test_a_large_body_without_a_header_is_refused_while_it_arrives(page):
    async def endless():
        for _ in range(LARGEST_BODY_BYTES // 2**20 + 2):
            yield bytes(2**20)

    assert page.ask("POST", "/api/edit", headers=ORIGIN, content=endless()).status_code == 413


def test_every_answer_is_protected(page, visitor):
    for answer in (page.get("/"), page.get("/api/plan"), visitor.get("/"), page.get("/nothing")):
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert "unsafe" not in answer.headers["content-security-policy"]
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert "access-control-allow-origin" not in answer.headers


def test_an_answer_with_a_policy_of_its_own_has_no_second_one(gate, page):
    async def app(scope, receive, send):
        headers = [(b"content-security-policy", b"style-src 'unsafe-inline'")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": b""})

    gate._app = app
    answer = page.get("/")
    assert answer.headers.get_list("content-security-policy") == ["style-src 'unsafe-inline'"]
    assert answer.headers["x-frame-options"] == "DENY"


def test_a_body_that_never_ends_is_given_up(page, monkeypatch):
    monkeypatch.setattr("desk.server.gate.REQUEST_S", 0.2)

    async def stuck():
        yield b"{"
        await anyio.sleep(60.0)

    answer = page.ask("POST", "/api/edit", headers=ORIGIN, content=stuck())
    assert answer.status_code == 408
    assert "did not arrive" in answer.json()["error"]
