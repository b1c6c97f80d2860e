"""Who may ask the server what; and one that is started and ended as a program."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.request import Request, urlopen

import psutil
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.ui import server
from cosim.ui.desk import Desk
from cosim.ui.server import ACTIONS, _states, application, listening
from tests.helpers.folders import ROOT
from tests.helpers.hang import HANG

pytest.importorskip("starlette")
pytest.importorskip("httpx2")
from starlette.testclient import TestClient

PORT, TOKEN = 8123, "a-token-that-nobody-guesses"
HOST = f"127.0.0.1:{PORT}"
ORIGIN = f"http://{HOST}"
GETS = ("/", "/state", "/controls", "/cases", "/drawn", "/case.toml", "/script/app.js", "/report")


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    made = Desk(load_case("pulley_edc"), tmp_path_factory.mktemp("runs"), is_live=False)
    yield made
    made.close()


@pytest.fixture
def client(desk: Desk) -> TestClient:
    app = application(desk, TOKEN, PORT)
    return TestClient(app, base_url=ORIGIN, headers={"X-Cosim-Token": TOKEN})


@pytest.fixture
def stranger(desk: Desk) -> TestClient:
    return TestClient(application(desk, TOKEN, PORT), base_url=ORIGIN, follow_redirects=False)


@pytest.mark.parametrize("path", [*GETS, "/events", "/nothing"])
def test_without_the_token_all_is_refused(stranger, path):
    answer = stranger.get(path)
    assert answer.status_code == 403
    assert "cosim ui" in answer.text
    assert stranger.get(path, headers={"X-Cosim-Token": TOKEN[:-1]}).status_code == 403
    assert stranger.post("/do/pin", headers={"Origin": ORIGIN}).status_code == 403


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", f"127.0.0.1:{PORT + 1}", "[::1]"])
def test_another_host_is_refused(client, host):
    assert client.get("/state", headers={"Host": host}).status_code == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", f"https://{HOST}", ""])
def test_another_origin_is_refused(client, origin):
    for answer in (
        client.get("/state", headers={"Origin": origin}),
        client.post("/do/unpin", headers={"Origin": origin}),
        client.post("/do/unpin"),
    ):
        assert answer.status_code == 403


def test_the_token_of_the_address_becomes_a_cookie(stranger):
    answer = stranger.get(f"/?token={TOKEN}")
    assert answer.status_code == 303
    assert answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert stranger.get("/").status_code == 200
    assert stranger.get("/state").json()["case"] == "pulley_edc"


def test_the_page_loads_from_nowhere_else(client):
    answer = client.get("/")
    assert not re.findall(r'(?:src|href)="(?:https?:)?//', answer.text)
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert "<script>" not in answer.text  # the policy would block it


def test_no_address_is_that_of_a_file(client):
    for path in ("/script/../desk.py", "/script/desk.py", "/script/%2e%2e/desk.py", "/etc/passwd"):
        assert client.get(path).status_code == 404


@pytest.mark.parametrize(
    "content", [b"no json", b"[1]", b"{}", b'{"key": "x", "text": "1"}', b"[" * 100_000]
)
def test_a_request_that_is_none_is_an_error_in_words(client, content):
    answer = client.post("/do/change", headers={"Origin": ORIGIN}, content=content)
    assert answer.status_code == 400
    assert answer.json()["error"]


def test_a_request_that_is_too_large_is_not_read_to_its_end(client, monkeypatch):
    """A request of the same kind is done, up to the size."""
    content = b'{"padding": "%s"}'
    monkeypatch.setattr(server, "MOST_BODY", 1000)
    for size, code in ((900, 200), (1000, 400)):
        body = content % (b"x" * size)
        answer = client.post("/do/unpin", headers={"Origin": ORIGIN}, content=body)
        assert answer.status_code == code
    assert "larger than a case file" in answer.json()["error"]


@pytest.mark.parametrize("path", [p for p in (*GETS, "/events") if p != "/"])
def test_the_token_in_an_address_opens_the_page_alone(stranger, path):
    """Addresses are kept by browsers: all else takes the cookie that the page gives."""
    assert stranger.get(f"{path}?token={TOKEN}").status_code == 403
    assert stranger.post(f"/do/unpin?token={TOKEN}", headers={"Origin": ORIGIN}).status_code == 403


def test_an_action_that_is_none_is_not_found(client):
    assert client.post("/do/quit", headers={"Origin": ORIGIN}).status_code == 404
    assert set(ACTIONS) >= {"change", "pin", "save", "stop"}


def test_names_are_escaped(tmp_path):
    case = load_case("pulley_edc").model_copy(
        update={"name": "<script>alert(1)</script>", "title": "</title><script>alert(2)</script>"}
    )
    desk = Desk(case, tmp_path, is_live=False)
    client = TestClient(
        application(desk, TOKEN, PORT), base_url=ORIGIN, headers={"X-Cosim-Token": TOKEN}
    )
    assert "alert" in client.get("/").text
    assert "<script>alert" not in client.get("/").text
    desk.close()


def test_the_state_is_told_at_once_and_after_every_change_until_the_end(desk, tmp_path):
    async def told() -> list[dict]:
        watched = Desk(load_case("pulley_edc"), tmp_path, is_live=False)
        states, out = _states(watched), []
        out.append(await anext(states))
        watched.hear("building the models")
        out.append(await anext(states))
        watched.close()
        assert [text async for text in states] in ([], [out[-1]])
        return [json.loads(text.removeprefix("data: ")) for text in out]

    first, second = asyncio.run(told())
    assert first["stage"] == ""
    assert second["stage"] == "building the models"
    assert second["version"] > first["version"]


def test_a_port_that_is_taken_is_said():
    with (
        listening(0) as at,
        pytest.raises(InputError, match="--port"),
        listening(at.getsockname()[1]),
    ):
        pass


def test_the_program_serves_its_page_and_leaves_nothing_behind(tmp_path: Path):
    command = [sys.executable, "-m", "cosim", "ui", "pulley_edc", "--no-browser"]
    program = subprocess.Popen(
        [*command, "--out", str(tmp_path)], stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    try:
        assert program.stderr is not None
        address = re.search(r"http://\S+", program.stderr.readline())[0]
        port, token = re.search(r":(\d+)/\?token=(\S+)", address).groups()
        asked = Request(f"http://127.0.0.1:{port}/state", headers={"X-Cosim-Token": token})
        end = time.monotonic() + HANG
        while (state := json.load(urlopen(asked, timeout=HANG)))["status"] != "done":
            assert time.monotonic() < end, state
            time.sleep(0.05)
        children = psutil.Process(program.pid).children(recursive=True)
        assert children
        # a tab that listens does not keep it
        with socket.create_connection(("127.0.0.1", port)) as tab:
            tab.sendall(
                f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
                f"X-Cosim-Token: {token}\r\n\r\n".encode()
            )
            assert b"200 OK" in tab.recv(1000)
            program.send_signal(signal.SIGINT if sys.platform != "win32" else signal.SIGTERM)
            assert program.wait(HANG) == 0
        _, alive = psutil.wait_procs(children, timeout=HANG)
        assert not [process for process in alive if process.status() != psutil.STATUS_ZOMBIE]
        with pytest.raises(ConnectionError):
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
    finally:
        program.kill()
        program.wait()
