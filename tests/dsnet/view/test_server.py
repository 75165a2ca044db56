"""The server: for its own page alone; files, readings, shapes and exports as the commands do."""

from __future__ import annotations

import http.client
import importlib.util
import json
import re
import signal
import socket
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest

from bridge.errors import DsnetError
from bridge.motion.readers.amass import sample_path
from dsnet.exporters.formats import FORMATS
from dsnet.view import application
from dsnet.view.clip_list import open_clip_list
from dsnet.view.scene import Scene
from dsnet.view.server import HOST
from tests.dsnet.view.pages import numbers, packaged, serve


@dataclass
class Client:
    """What a page can ask of a server."""

    address: str

    @property
    def origin(self) -> str:
        return "/".join(self.address.split("/")[:3])

    def send(
        self, method: str, path: str, body: bytes | None = None, **headers: str
    ) -> tuple[int, bytes]:
        """Status and body of the answer; `path` is below the page's own, or begins with `/`."""
        where = path if path.startswith("/") else "/" + self.address.split("/", 3)[3] + path
        port = int(self.origin.rpartition(":")[2])
        with closing(http.client.HTTPConnection(HOST, port)) as connection:
            connection.request(method, where, body, {"Origin": self.origin, **headers})
            answer = connection.getresponse()
            return answer.status, answer.read()

    def get(self, path: str, **headers: str) -> tuple[int, bytes]:
        return self.send("GET", path, None, **headers)

    def ask(self, path: str, **asked: Any) -> Any:
        """The JSON of an answer."""
        return json.loads(self.send("POST", path, json.dumps(asked).encode())[1])

    def drop(self, name: str, data: bytes) -> Any:
        return json.loads(self.send("POST", f"files/{quote(name, safe='')}", data)[1])

    def exported(self, number: int, to: str, scene: int = 0, **shown: Any) -> bytes:
        """The file of an export, when it is there."""
        asked = {"scene": scene, "number": number, "to": to, "predictors": ["dsnet_plus"]}
        assert "command" in self.ask("export", **asked, shown=shown)
        while not {"file", "failed"} & set(state := json.loads(self.get("export/state")[1])):
            time.sleep(0.1)
        assert "failed" not in state, state
        return self.get("export/file")[1]


@pytest.fixture(scope="module")
def scene(run) -> Scene:
    return Scene(open_clip_list(run, None))


@pytest.fixture(scope="module")
def client(scene) -> Iterator[Client]:
    with serve(scene) as address:
        yield Client(address)


@pytest.fixture(scope="module")
def samples() -> Iterator[Client]:
    """Of the packaged model, with the sample of a dance."""
    with serve(packaged()) as address:
        yield Client(address)


@pytest.fixture(scope="module")
def short(tmp_path_factory) -> Path:
    """Some frames of a walk."""
    path = tmp_path_factory.mktemp("short") / "short.npz"
    with np.load(sample_path("walking")) as walk:
        count = len(walk["poses"])
        np.savez(
            path, **{name: v[:24] if v.shape[:1] == (count,) else v for name, v in walk.items()}
        )
    return path


WALK = sample_path("walking").read_bytes()


def test_it_gives_the_page_and_what_it_shows(client, scene):
    status, page = client.get("")
    assert (status, b"connect-src 'self'" in page) == (200, True)
    assert client.get("assets/0/motion0") == (200, scene.assets["motion0"]())


@pytest.mark.parametrize(
    "path",
    ["assets/0/../page.py", "assets/0/", "assets/0/no", "assets/9/scene", "assets/x/scene",
     "/", "/etc/passwd", "/assets/0/scene", "/wrong/formats", "export/file"],
)  # fmt: skip
def test_nothing_else_is_given(client, path):
    assert client.get(path)[0] in (400, 404)


def test_a_page_of_another_name_or_site_gets_nothing(client):
    assert client.get("", Host="example.org")[0] == 404
    for headers in ({"Origin": "http://example.org"}, {"Origin": "null"}):
        assert client.send("POST", "files/a.npz", WALK, **headers)[0] == 403


def test_what_fails_is_one_line(client, scene, monkeypatch):
    def broken() -> bytes:
        raise DsnetError("no file", "one", "Look for it.")

    monkeypatch.setitem(scene.assets, "motion1", broken)
    status, told = client.get("assets/0/motion1")
    assert (status, json.loads(told)) == (200, {"failed": "no file; expected one. Look for it."})


def test_a_dropped_file_is_read_and_read_again_by_other_options(samples):
    given = samples.drop("walk.npz", WALK)
    assert given["entry"] == {"name": "walk", "tracks": [], "reading": {}}
    where = {"scene": given["scene"], "number": given["number"]}
    path = f"assets/{given['scene']}/motion{given['number']}"
    before = json.loads(samples.get(path)[1])
    slower = samples.ask("read", **where, reading={"motion_fps": "30", "floor": "shift"})
    assert slower == {**where, "entry": {**given["entry"], "reading": slower["entry"]["reading"]}}
    after = json.loads(samples.get(path)[1])
    assert after["count"] > 1.5 * before["count"]
    again = samples.ask("read", **where, reading={"motion_fps": "", "floor": ""})
    assert again == given
    same = json.loads(samples.get(path)[1])
    np.testing.assert_array_equal(numbers(same["theta"], "<f8"), numbers(before["theta"], "<f8"))
    refused = samples.ask("read", **where, reading={"motion_fps": "fast"})
    assert "a number" in refused["failed"]
    assert "--up x" in samples.ask("read", **where, reading={"up": "x"})["failed"]
    man = samples.ask("read", **where, reading={"gender": "male"})
    assert man["scene"] != given["scene"]
    assert json.loads(samples.get(f"assets/{man['scene']}/scene")[1])["gender"] == "male"


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.npz", WALK[:1000], "a.npz"),
        ("a.bvh", b"HIERARCHY\n", "a.bvh"),
        ("../../evil.npz", b"", "evil.npz"),
        ("\0", b"x", "type unknown"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_line_and_leaves_nothing(samples, name, data, words):
    failed = samples.drop(name, data)["failed"]
    assert words in failed
    assert "dsnet-view" not in failed
    assert "\n" not in failed


def test_nothing_is_left_of_files(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with serve(packaged()) as address:
        client = Client(address)
        client.drop("a.npz", WALK[:1000])
        client.drop("../../walk.npz", WALK)
        client.drop("walk.npz", WALK)
        kept = [path for path in tmp_path.rglob("*") if path.is_file()]
        assert [path.name for path in kept] == ["walk.npz", "walk.npz"]
    assert list(tmp_path.iterdir()) == []


def test_too_large_a_file_is_refused_before_it_is_read(samples, monkeypatch):
    monkeypatch.setattr(application, "LARGEST_FILE", 1000)
    assert "at most" in samples.drop("walk.npz", WALK)["failed"]


def test_a_shape_in_words_is_that_of_the_option(samples):
    tall = samples.ask("shape", scene=0, words="height=182")["betas"]
    assert tall[0] > 1
    assert "smaller" in samples.ask("shape", scene=0, words="smaller")["failed"]


OF_MOTIONS = [name for name, one in FORMATS.items() if one.needs_motion]


@pytest.mark.slow
@pytest.mark.parametrize("to", OF_MOTIONS)
def test_an_export_has_the_bytes_of_the_command(samples, short, tmp_path, to):
    if (package := FORMATS[to].package) and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    given = samples.drop(short.name, short.read_bytes())
    shown = {"gain": 2, "part_gain": ["belly=1.5"], "floor": "shift"}
    data = samples.exported(given["number"], to, **shown)
    # In a process of its own, as the page's: how many threads compute decides about last bits.
    out = tmp_path / (short.stem + "".join(FORMATS[to].suffixes[:1]))
    command = [sys.executable, "-m", "dsnet.cli", "export", "--to", to, "--motion", str(short)]
    options = ["--gain", "2", "--part-gain", "belly=1.5", "--floor", "shift"]
    subprocess.run([*command, *options, "--out", str(out)], check=True, capture_output=True)
    if to == "abc":  # says when it was written
        given, expected = (np.frombuffer(each, np.uint8) for each in (data, out.read_bytes()))
        assert np.count_nonzero(given != expected) <= len("Mon Jan  1 00:00:00 2000")
        return
    if out.is_file():
        assert data == out.read_bytes()
        return
    with zipfile.ZipFile(BytesIO(data)) as archive:
        assert {*archive.namelist()} == {path.name for path in out.iterdir()}
        for path in out.iterdir():
            assert archive.read(path.name) == path.read_bytes()


def test_an_export_can_be_cancelled_and_says_why_it_fails(samples):
    asked = {"scene": 0, "number": 0, "to": "gif", "predictors": [], "shown": {}}
    assert samples.ask("export", **asked)["command"].startswith("dsnet export --to gif")
    assert "one at a time" in samples.ask("export", **asked)["failed"]
    samples.ask("cancel")
    assert json.loads(samples.get("export/state")[1]) is None
    assert "bvh" not in samples.ask("export", **{**asked, "to": "onnx"})["failed"]
    assert samples.ask("export", **{**asked, "shown": {"gain": 900}})["failed"]


def test_a_taken_port_is_one_line(scene):
    taken = socket.create_server((HOST, 0))
    refused = pytest.raises(DsnetError, match="--port")
    with taken, refused, serve(scene, taken.getsockname()[1]):
        pass


@pytest.mark.slow
def test_the_command_serves_until_it_is_interrupted():
    command = [sys.executable, "-m", "dsnet.cli", "view", "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as served:
        assert served.stderr is not None
        found = re.search(r"open (http://127.0.0.1:\d+/\S+/) ", served.stderr.readline())
        assert found is not None
        assert Client(found[1]).get("")[0] == 200
        served.send_signal(signal.SIGINT)
        rest = served.stderr.read()
    assert served.returncode == 130
    assert "Traceback" not in rest
