"""FBX of one walk is the walk of its BVH, of its GLB and of its VRMA; what is odd is told."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.errors import MissingPackageError
from bridge.motion import load_motion
from bridge.motion.motion import HowRead
from bridge.motion.readers import fbx as reader
from bridge.motion.skeletons import OWN_NAMES
from tests.forged import scenes
from tests.forged.walks import FRAMES, bvh


def written(tmp_path: Path, text: str | bytes, name: str = "walk.fbx") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def refused(path: Path) -> str:
    with pytest.raises(DsnetError) as caught:
        load_motion(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_one_walk_in_four_formats_is_one_motion(tmp_path: Path) -> None:
    files = {
        "walk.bvh": bvh(),
        "walk.fbx": scenes.fbx(),
        "walk.glb": scenes.glb(*scenes.gltf()),
        "walk.vrma": scenes.vrma(),
    }
    first, *others = [
        load_motion(written(tmp_path, content, name)) for name, content in files.items()
    ]
    for motion in others:
        np.testing.assert_allclose(motion.theta, first.theta, atol=1e-5)
        assert (motion.fps, motion.source_fps) == (60.0, 60.0)


def test_the_stated_vertical_is_believed_and_the_user_more(tmp_path: Path) -> None:
    path = written(tmp_path, scenes.fbx(up="z", unit_cm=2.54))
    plain = load_motion(written(tmp_path, bvh(), "walk.bvh"))
    np.testing.assert_allclose(load_motion(path).theta, plain.theta, atol=1e-5)
    np.testing.assert_allclose(load_motion(path, how=HowRead("z")).theta, plain.theta, atol=1e-5)
    assert np.abs(load_motion(path, how=HowRead("y")).theta - plain.theta).max() > 1


def test_joints_of_other_names_are_the_users(tmp_path: Path) -> None:
    path = written(tmp_path, scenes.fbx([f"bone{n}" for n in range(24)]))
    assert "has no pelvis" in refused(path)
    joint_map = {name: f"bone{n}" for n, name in enumerate(OWN_NAMES)}
    motion = load_motion(path, how=HowRead(joint_map=joint_map))
    plain = load_motion(written(tmp_path, bvh(), "walk.bvh"))
    np.testing.assert_allclose(motion.theta, plain.theta, atol=1e-5)


def test_a_take_that_is_shorter_than_its_keys_is_told(tmp_path: Path) -> None:
    text = scenes.fbx()
    stop = 'P: "LocalStop", "KTime", "Time", "",'
    before, _, after = text.partition(stop)
    path = written(tmp_path, before + stop + str(46186158000) + after[after.index("\n") :])
    motion = load_motion(path)
    assert len(motion.theta) == 61
    assert "keys from 0.00 to 1.48 s, of which the take is 0.00 to 1.00 s" in motion.notes[1]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('"LimbNode"', '"Mesh"', "has no skeleton"),
        ("AnimationCurve:", "Nothing:", "moves no joint"),
        ("Matrix: *16 { a: ", "Matrix: *16 { a: nan,", "not all finite"),
    ],
)
def test_what_cannot_be_followed_is_one_line(
    tmp_path: Path, old: str, new: str, complaint: str
) -> None:
    assert complaint in refused(written(tmp_path, scenes.fbx().replace(old, new)))


@pytest.mark.parametrize(
    "content", ["", "Kaydara FBX Binary", "; FBX 7.4.0 project file\nObjects: {"]
)
def test_what_is_no_fbx_is_one_line(tmp_path: Path, content: str) -> None:
    assert "walk.fbx" in refused(written(tmp_path, content))


def test_what_is_not_there_is_one_line(tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "gone.fbx")


def test_without_the_extra_one_line_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, scenes.fbx())
    monkeypatch.setitem(sys.modules, "ufbx", None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr("bridge.installation.find_spec", lambda name: None)
    with pytest.raises(
        MissingPackageError, match=r"without ufbx; expected .* reading FBX .*\[fbx\]"
    ):
        load_motion(path)


def test_a_reader_that_crashes_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As libraries in C do on files of strangers; this process lives on."""
    (tmp_path / "crashes.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(reader, "_PROCESS", "crashes")
    path = written(tmp_path, scenes.fbx(takes={"walk": FRAMES}))
    assert "its reader ended with -11" in refused(path)
