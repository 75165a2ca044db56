"""What cannot be shown is said in one line."""

from __future__ import annotations

import importlib.util
import re
import socket

import pytest

from bridge.cli import main
from bridge.runs import Run

needs_viser = pytest.mark.skipif(
    importlib.util.find_spec("viser") is None, reason="viser is not installed"
)


def refused(capsys: pytest.CaptureFixture[str], *options: str) -> str:
    with pytest.raises(SystemExit) as caught:
        main(["view", *options])
    message = capsys.readouterr().err
    assert caught.value.code == 2
    assert message.count("\n") == 1
    return message


def test_without_the_extra_it_is_named(capsys, monkeypatch):
    monkeypatch.setattr("bridge.installation.find_spec", lambda name: None)
    assert '[viewer]"' in refused(capsys).partition("pip install")[2]


@needs_viser
def test_a_port_in_use(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert re.search(
            rf"--port {port}, .*in use.*--port 0", refused(capsys, "--port", f"{port}")
        )


@needs_viser
@pytest.mark.parametrize("port", ["-1", "65536"])
def test_no_port(capsys, port):
    assert "0 to 65535" in refused(capsys, "--port", port)


@needs_viser
def test_an_address_of_another_machine(capsys):
    assert "--host 192.0.2.1" in refused(capsys, "--host", "192.0.2.1", "--port", "0")


@needs_viser
def test_unknown_runs_and_those_without_a_trained_model(capsys, run):
    assert "unknown run 'nope'" in refused(capsys, "--run", "nope", "--port", "0")
    bare = Run("bare")
    (bare.path / "align").parent.mkdir(parents=True)
    message = refused(capsys, "--run", "bare", "--port", "0")
    assert "run 'bare' without a trained predictor" in message


@needs_viser
def test_what_is_no_motion(capsys, tmp_path):
    file = tmp_path / "a.npz"
    assert "does not exist" in refused(capsys, "--motion", str(file), "--port", "0")
    file.write_bytes(b"PK nothing")
    assert "AMASS motion file" in refused(capsys, "--motion", str(file), "--port", "0")


@needs_viser
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--part-gain", "nose=2"], "--part-gain nose=2"),
        (["--gain", "21"], "--gain 21.0; expected 0 to 20"),
        (["--shape", "wide"], "shape 'wide'; expected tall"),
        (["--shape", "height=300"], "a shape of height=300"),
        (["--shape", "betas=1,2"], "--shape betas=1,2; expected 10"),
        (["--loop", "--motion", "sample:dancing"], "--loop with a motion"),
    ],
)
def test_controls_are_checked(capsys, options, message):
    assert message in refused(capsys, *options, "--port", "0")


@needs_viser
def test_a_recording_overwrites_nothing(capsys, tmp_path):
    there = tmp_path / "a.html"
    there.write_text("mine")
    assert "which exists" in refused(capsys, "--record", str(there), "--port", "0")
    assert "cannot be written" in refused(capsys, "--record", str(there / "b.html"))
    assert there.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["a.html"]


@needs_viser
def test_a_recording_without_room_leaves_nothing(capsys, tmp_path):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, before[1]))
    try:
        assert "cannot be written" in refused(capsys, "--record", str(tmp_path / "a.html"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
