"""The command: address, parallel requests, refusals."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import enumerate as enumerate_threads

import httpx
import pytest
from typer.testing import CliRunner

from desk.server.gate import Gate
from desk.server.serve import Opened, Opening, _serve, desk_app
from firnline.cli.main import app
from survey.core import InputError
from tests.desk.conftest import PORT, Page

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def running(dem_file, tmp_path) -> Iterator[tuple[subprocess.Popen, str]]:
    """A desk in a process of its own, and its address."""
    (tmp_path / "hills.tif").write_bytes(dem_file.read_bytes())
    command = [sys.executable, "-m", "firnline", "desk", "hills.tif", "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process, re.search(r"http\S+", process.stdout.readline())[0]
        process.kill()


def test_a_real_server_answers_a_hundred_requests_at_once_and_ends_on_interrupt(running):
    process, address = running
    assert address.startswith("http://127.0.0.1:")
    origin = address.split("/?")[0]
    with httpx.Client(timeout=60.0) as client:
        client.get(address).raise_for_status()
        paths = ["/api/plan", "/tiles/relief/0/0/0.png", "/static/js/main.js", "/api/site"] * 25
        with ThreadPoolExecutor(100) as pool:
            found = list(pool.map(lambda path: client.get(origin + path).status_code, paths))
    assert found == [200] * 100
    process.send_signal(signal.SIGINT)
    assert process.wait(20.0) in (0, 130)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_the_terrain_is_opened_ends_the_desk(running, number, tmp_path):
    process, _ = running
    process.send_signal(number)
    assert process.wait(20.0) in (0, 130, -signal.SIGTERM)  # before and after it is handled
    assert not list(tmp_path.glob("*.lock"))


def test_after_an_interrupt_that_a_callback_swallows_the_desk_loads_nothing(workspace):
    def open_source() -> Opened:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return Opened(workspace, desk_app(workspace), lambda _: None)

    _serve(open_source, 0, opens_browser=False, opens_surely=True)
    assert "desk-loading" not in [thread.name for thread in enumerate_threads()]


@pytest.mark.timeout(60)
def test_an_interrupt_that_a_callback_swallows_as_the_address_appears_ends_the_desk(workspace, monkeypatch):
    def browse(_: str) -> None:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("webbrowser.open", browse)
    opened = Opened(workspace, desk_app(workspace), lambda _: None)
    _serve(lambda: opened, 0, opens_browser=True, opens_surely=True)
    assert "desk-server" not in [thread.name for thread in enumerate_threads()]


def test_a_real_server_is_not_reached_from_elsewhere(running):
    _, address = running
    port = int(re.search(r":(\d+)/", address)[1])
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {
        "127.0.0.1",
        "127.0.1.1",
    }
    for host in others:
        with pytest.raises(ConnectionError):
            socket.create_connection((host, port), timeout=2.0)


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["missing.tif"], 3, "missing.tif"),
        ([], 3, "holds no plan of the desk"),
        (["notes.txt"], 3, "notes.txt"),
        (["--demo", "hills.tif"], 4, "leave out hills.tif"),
        (["broken.desk.json"], 3, "damaged"),
    ],
)
def test_what_cannot_be_opened_is_refused_in_a_sentence(tmp_path, monkeypatch, arguments, code, text):
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("text")
    if "broken.desk.json" in arguments:
        Path("broken.desk.json").write_text("{")
    result = CliRunner().invoke(app, ["desk", *arguments, "--no-browser"])
    assert result.exit_code == code, result.output
    assert text in result.output
    assert "Traceback" not in result.output


def test_the_page_is_served_before_the_terrain_is_open_and_the_rest_when_it_is(workspace):
    opening = Opening()
    page = Page(Gate(opening, PORT))
    assert b"Opening the terrain" in page.get("/").content
    assert page.get("/static/js/main.js").status_code == 200
    with ThreadPoolExecutor(1) as other:
        asked = other.submit(page.get, "/api/site")
        time.sleep(0.1)
        assert not asked.done()
        opening.opened.set_result(Opened(workspace, desk_app(workspace), lambda _: None))
        assert asked.result(10.0).json()["name"] == workspace.name
        asked = other.submit(page.get, "/api/fields")
        time.sleep(0.1)
        assert not asked.done()
        opening.loaded.set_result(None)
        assert asked.result(30.0).status_code == 200


def test_a_page_that_waits_is_shown_why_nothing_can_be_opened():
    opening = Opening()
    page = Page(Gate(opening, PORT))
    opening.opened.set_exception(InputError("hills.tif is damaged; read it again."))
    answer = page.get("/api/site")
    assert (answer.status_code, answer.json()["error"]) == (422, "hills.tif is damaged; read it again.")
    assert opening.has_refused.is_set()


def test_the_address_of_the_next_window_is_published_from_the_first_visit_on():
    gate, published = Gate(lambda *_: None, PORT), []
    first = gate.address
    gate.publish_to(published.append)
    assert published == [first]
    Page(gate)
    assert published[-1] == gate.address != first


def test_a_port_that_is_taken_is_refused(dem_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("hills.tif").write_bytes(dem_file.read_bytes())
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        result = CliRunner().invoke(app, ["desk", "hills.tif", "--port", port, "--no-browser"])
    assert result.exit_code == 3
    assert f"port {port}" in result.output


def test_a_second_desk_of_the_plan_joins_the_first_one(running, tmp_path):
    process, first = running
    assert process.stdout.readline().startswith("plan ")  # it holds the plan now
    command = [sys.executable, "-m", "firnline", "desk", "hills.tif", "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for _ in range(2):
        second = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60, check=True
        )
        assert "is open already" in second.stdout
        address = re.search(r"http\S+", second.stdout)[0]
        assert address.split("/?")[0] == first.split("/?")[0]
        assert httpx.get(address).status_code == 200
        assert httpx.get(address).status_code == 401


def test_half_of_a_request_is_not_waited_for(server, monkeypatch):
    monkeypatch.setattr("desk.server.gate.REQUEST_S", 0.3)
    port = int(server.origin.rpartition(":")[2])
    for begun in (b"", b"GET / HT", b"GET / HTTP/1.1\r\nhost: 127.0.0.1"):
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as connection:
            connection.sendall(begun)
            assert connection.recv(1000) == b""


def test_streams_hold_no_threads(server):
    def endless(job):
        while True:
            job.progress("waiting", 0, 1)
            time.sleep(0.05)

    job = server.workspace.jobs.start(endless)
    with httpx.Client(timeout=20.0) as client, ExitStack() as streams:
        client.get(server.gate.address).raise_for_status()
        address = f"{server.origin}/api/jobs/{job.name}/events"
        opened = [streams.enter_context(client.stream("GET", address)) for _ in range(41)]
        texts = [next(stream.iter_text()) for stream in opened if stream.status_code == 200]
        assert len(texts) == 32
        assert all("waiting" in text for text in texts)
        assert {stream.status_code for stream in opened} == {200, 429}
        assert client.get(f"{server.origin}/tiles/relief/0/0/0.png").status_code == 200
        streams.close()
        assert client.get(f"{server.origin}/api/plan").status_code == 200
    server.workspace.jobs.cancel_all()


def test_a_client_that_leaves_in_the_middle_of_a_body_is_no_fault(server, caplog):
    with httpx.Client() as client:
        client.get(server.gate.address).raise_for_status()
        cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
    host = server.origin.removeprefix("http://")
    head = f"host: {host}\r\norigin: {server.origin}\r\ncookie: {cookie}\r\ncontent-length: 99\r\n"
    with socket.create_connection(("127.0.0.1", int(host.partition(":")[2])), timeout=10.0) as connection:
        connection.sendall(f"POST /api/edit HTTP/1.1\r\n{head}\r\n{{".encode())
        time.sleep(0.3)
    time.sleep(0.5)
    assert caplog.text == ""
