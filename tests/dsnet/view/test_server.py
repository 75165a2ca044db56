"""The server: for this machine alone, its own names, and one line where something fails."""

from __future__ import annotations

import http.client
import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest

from bridge.errors import DsnetError
from dsnet.view.clip_list import open_clip_list
from dsnet.view.page import HOST, serving
from dsnet.view.scene import Scene


@pytest.fixture(scope="module")
def scene(run) -> Scene:
    return Scene(open_clip_list(run, None))


@pytest.fixture(scope="module")
def port(scene) -> Iterator[int]:
    with serving(scene, 0) as address:
        yield int(address.rstrip("/").rpartition(":")[2])


def got(port: int, path: str, host: str | None = None) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection(HOST, port)
    connection.request("GET", path, headers={"Host": host or f"{HOST}:{port}"})
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_it_gives_the_page_and_what_it_shows(port, scene):
    status, page = got(port, "/")
    assert (status, b"connect-src 'self'" in page) == (200, True)
    assert got(port, "/assets/motion0") == (200, scene.assets["motion0"]())


@pytest.mark.parametrize("path", ["/assets/../page.py", "/etc/passwd", "/assets/", "/assets/no"])
def test_nothing_else_is_given(port, path):
    assert got(port, path)[0] == 404


def test_a_page_of_another_name_gets_nothing(port):
    assert got(port, "/", host="example.org")[0] == 403


def test_what_fails_is_one_line(port, scene, monkeypatch):
    def broken() -> bytes:
        raise DsnetError("no file", "one", "Look for it.")

    monkeypatch.setitem(scene.assets, "motion1", broken)
    status, told = got(port, "/assets/motion1")
    assert (status, json.loads(told)) == (200, {"failed": "no file; expected one. Look for it."})


def test_a_taken_port_is_one_line(scene):
    taken = socket.create_server((HOST, 0))
    refused = pytest.raises(DsnetError, match="--port")
    with taken, refused, serving(scene, taken.getsockname()[1]):
        pass


@pytest.mark.slow
def test_the_command_serves_until_it_is_interrupted():
    command = [sys.executable, "-m", "dsnet.cli", "view", "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as served:
        assert served.stderr is not None
        found = re.search(r"open http://127.0.0.1:(\d+)/", served.stderr.readline())
        assert found is not None
        assert got(int(found[1]), "/")[0] == 200
        served.send_signal(signal.SIGINT)
        rest = served.stderr.read()
    assert served.returncode == 130
    assert "Traceback" not in rest
