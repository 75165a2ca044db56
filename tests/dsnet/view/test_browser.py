"""The page in a real browser: the bodies that Python poses, untorn, served and from a disk."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.body.parts import PARTS
from bridge.errors import DsnetError
from bridge.motion import load_motion
from bridge.motion.readers.amass import sample_path
from dsnet.cli import main
from dsnet.prediction.controls import root_joint_m
from dsnet.view.clip_list import open_clip_list
from dsnet.view.scene import STEP_M, Scene
from tests.dsnet.view.conftest import JUMP
from tests.dsnet.view.pages import (
    BETAS,
    TORN,
    Shown,
    dropped,
    on_disk,
    packaged,
    read_by_page,
    serve,
    served,
)
from tests.forged.amass import smplh
from tools.headless_chromium import open_page, why_missing

if TYPE_CHECKING:
    pass

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_missing() is not None, reason=why_missing() or ""),
]


@pytest.fixture(scope="module")
def dancing(browser) -> Iterator[Shown]:
    with served(browser, packaged()) as shown:
        yield shown
        assert shown.errors == []


@pytest.fixture(scope="module")
def file(browser, tmp_path_factory) -> Iterator[Shown]:
    """A page from a disk, which reads AMASS's files itself."""
    with on_disk(browser, tmp_path_factory.mktemp("page") / "a.html", packaged()) as shown:
        yield shown
        assert shown.errors == []


@pytest.fixture(scope="module")
def with_truth(browser, run) -> Iterator[Shown]:
    with served(browser, Scene(open_clip_list(run, None))) as shown:
        yield shown
        assert shown.errors == []


@pytest.mark.parametrize("gender", ["female", "male"])
def test_bodies_are_those_of_predict_after_any_jump_in_any_shape(browser, tmp_path, gender):
    with np.load(sample_path("dancing")) as sample:
        np.savez(tmp_path / "a.npz", **{**sample, "gender": np.array(gender)})
    with served(browser, packaged(tmp_path / "a.npz")) as shown:
        shown.moves_as_predicted(tmp_path / "a.npz", -1, 0, 131, 7)
        shown.page.evaluate("(betas) => page.person(betas)", BETAS)
        shown.set(**{"gain": 2, f"part{PARTS.index('belly')}": 3})
        asked = {"betas": ",".join(map(str, BETAS)), "gain": 2.0, "part_gain": ("belly=3",)}
        shown.moves_as_predicted(tmp_path / "a.npz", 60, -1, 0, **asked)
        assert shown.errors == []


def test_what_plays_is_what_rests_pixel_by_pixel(dancing):
    dancing.surveyed()
    dancing.set(colouring="size")
    assert dancing.page.evaluate(TORN, 12) == 0
    dancing.set(colouring="none")


def test_a_loop_is_that_of_predict(browser):
    with served(browser, packaged("sample:walk_cycle")) as shown:
        shown.set(loop=True)
        shown.until("page.motion.first > 0")
        shown.moves_as_predicted("sample:walk_cycle", 0, -1, close_m=3e-4, loop=True)


def test_the_truth_is_in_step_and_curves_are_its_distances(with_truth):
    with_truth.surveyed()
    alone_m, true_m = (with_truth.vertices_m(name, 40) for name in ("smpl", "truth"))
    apart_m = np.linalg.norm(true_m - alone_m, axis=1)
    # The forged truth is an offset of a centimetre along each axis.
    np.testing.assert_allclose(apart_m, np.sqrt(3) * 0.01, atol=4 * STEP_M)
    curve = with_truth.page.evaluate("page.curves[40]")
    np.testing.assert_allclose(curve["smpl"]["apart"], apart_m.mean(), rtol=1e-4)
    with_truth.set(colouring="apart")
    with_truth.vertices_m("truth", 41)
    _same_size(with_truth, "smpl", apart_m.mean())


def _same_size(shown: Shown, name: str, mean_m: float) -> None:
    sizes = shown.page.evaluate(
        "(name) => [...page.stage.bodies[name].geometry.attributes.uv.array]", name
    )
    np.testing.assert_allclose(np.mean(sizes), mean_m, rtol=0.02)


def test_who_is_too_large_for_a_page_comes_as_a_track(browser, run):
    clip_list = open_clip_list(run, None)
    plus = clip_list.open("dsnet_plus")
    twin = replace(
        clip_list,
        predictors={"dsnet_plus": "DSNet+", "twin": "DSNet"},
        open={"dsnet_plus": plus, "twin": plus}.__getitem__,
    )
    with served(browser, Scene(twin)) as shown:
        assert shown.page.evaluate("page.motion.tracks") == ["truth"]
        shown.set(**{"show-twin": True})
        shown.until("page.motion.tracks.includes('twin')")
        live_m, track_m = (shown.vertices_m(name, 30) for name in ("dsnet_plus", "twin"))
        np.testing.assert_allclose(track_m, live_m, atol=STEP_M)
        assert shown.errors == []


def test_what_python_cannot_make_is_one_line(browser, run, monkeypatch):
    scene = Scene(open_clip_list(run, None))

    def broken() -> bytes:
        raise DsnetError("a damaged truth", "another", "Make it again.")

    monkeypatch.setitem(scene.assets, "track0_truth", broken)
    with serve(scene) as address, open_page(browser, address) as opened:
        opened.page.get_by_text("a damaged truth; expected another. Make it again.").wait_for()
        assert np.isfinite(Shown(opened).vertices_m("dsnet_plus", 3)).all()
        assert opened.errors == []


def test_another_shape_has_no_truth(with_truth):
    with_truth.page.evaluate("(betas) => page.person(betas)", BETAS)
    with_truth.until("document.getElementById('tag-truth').hidden")
    with_truth.set(person="shape of the motion's performer")
    with_truth.until("!document.getElementById('tag-truth').hidden")


def test_a_file_opens_from_a_disk_without_a_network(browser, tmp_path):
    out = tmp_path / "a.html"
    main(["export", "--to", "html", "--motion", "sample:jumping_jacks", "--gain", "2",
          "--out", str(out)])  # fmt: skip
    assert out.stat().st_size < 10e6
    with on_disk(browser, out) as shown:
        shown.moves_as_predicted("sample:jumping_jacks", 100, gain=2.0)
        asked = "() => fetch('https://example.org/').then(() => 'sent', () => 'kept')"
        assert shown.page.evaluate(asked) == "kept"
        assert [one for one in shown.errors if "example.org" not in one] == []


def test_gains_between_steps_and_beyond_ends_stand_until_a_hand_moves_them(browser, tmp_path):
    asked: dict[str, Any] = {"gain": 1.03, "part_gain": ("belly=8", "chest=0.02")}
    scene = Scene(open_clip_list(None, Path("sample:dancing")), asked)
    with on_disk(browser, tmp_path / "a.html", scene) as shown:
        shown.moves_as_predicted("sample:dancing", 60, **asked)
        assert _told(shown) == ["1.03", "8.00", "0.02"]
        shown.page.press("#gain", "ArrowRight")
        assert _told(shown) == ["1.10", "8.00", "0.02"]
        asked["gain"] = 1.1
        shown.moves_as_predicted("sample:dancing", 60, **asked)


def _told(shown: Shown) -> list[str]:
    knobs = ["gain", *(f"part{PARTS.index(part)}" for part in ("belly", "chest"))]
    return [shown.page.text_content(f"#{knob} + output") for knob in knobs]


def test_a_baked_body_plays(browser, run, tmp_path):
    clip_list = open_clip_list(run, None)
    clips = {JUMP: clip_list.clips[JUMP]}
    body = replace(clip_list.best.body, source="licensed")
    best = replace(clip_list.best, other_body=body)
    baked = replace(clip_list, best=best, clips=clips)
    with on_disk(browser, tmp_path / "a.html", Scene(baked)) as shown:
        assert "Synthetic flesh" in shown.page.inner_text("#notice")
        assert "licence" in shown.page.inner_text("#notice")
        alone_m, true_m = (shown.vertices_m(name, 40) for name in ("smpl", "truth"))
        apart_m = np.linalg.norm(true_m - alone_m, axis=1)
        np.testing.assert_allclose(apart_m, np.sqrt(3) * 0.01, atol=4 * STEP_M)
        assert shown.errors == []


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("rate", [60, 50, 59.94, 100, 120.00004577636719])
def test_a_file_is_read_as_python_reads_it(file, tmp_path, rate, up):
    with np.load(sample_path("dancing")) as sample:
        arrays = {**sample, "mocap_framerate": np.array(rate), "betas": np.linspace(-1, 1, 16)}
    if up == "y":
        arrays |= y_up(arrays)
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    found, expected = read_by_page(file, tmp_path / "a.npz"), load_motion(tmp_path / "a.npz")
    np.testing.assert_allclose(np.reshape(found["theta"], (-1, 69)), expected.theta, atol=1e-12)
    np.testing.assert_array_equal(found["betas"], expected.betas)
    assert found["gender"] == expected.gender
    assert ("y up" in " ".join(found["says"])) == (up == "y")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"gender": "f"}, ""),
        ({"gender": np.bytes_(b"M")}, ""),
        ({"gender": np.array(0)}, ""),
        ({"gender": "2"}, ""),
        ({"betas": np.linspace(0, 1, 900 * 16).reshape(900, 16) ** 2}, "the median is taken"),
        ({"betas": np.linspace(-1, 1, 16)[None]}, ""),
        ({"betas": np.linspace(-1, 1, 16)[:, None]}, ""),
        ({"mocap_time_length": 9.0}, "says that it lasts 9 s, but 5 frames at 120 a second"),
        ({"fps": 119.0, "mocap_time_length": 5 / 120}, ""),
    ],
)
def test_what_a_file_says_is_taken_as_python_takes_it(file, tmp_path, changed, words):
    np.savez_compressed(tmp_path / "a.npz", **{**smplh(), **changed})
    found, expected = read_by_page(file, tmp_path / "a.npz"), load_motion(tmp_path / "a.npz")
    assert found["gender"] == expected.gender
    np.testing.assert_array_equal(found["betas"], expected.betas)
    assert found["frames"] == len(expected.theta)
    for says in (found["says"], expected.notes):
        assert len(says) == bool(words)
        assert words in "".join(says)


def y_up(arrays: dict[str, Any]) -> dict[str, Any]:
    """The same motion as programs of animation store it."""
    turn = Rotation.from_euler("x", -90, degrees=True)
    poses = arrays["poses"].copy()
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    return {"poses": poses, "trans": turn.apply(arrays["trans"])}


@pytest.mark.parametrize(
    ("source", "gender", "whose"),
    [
        ("synthetic", "female", ""),
        ("synthetic", "unknown", ""),
        ("synthetic", "male", "a male body's, the body is female"),
        ("a stranger's", "female", "another body model's"),
    ],
)
def test_a_dropped_motion_plays_as_predicted(browser, tmp_path, source, gender, whose):
    """On the body of its betas, or, where they are another's, of the mean shape."""
    changed = {"mocap_framerate": 100, "betas": np.linspace(-1, 1, 16)}
    with np.load(sample_path("walking")) as sample:
        np.savez(tmp_path / "mine.npz", **{**sample, **changed, "source": source, "gender": gender})
    with on_disk(browser, tmp_path / "a.html", packaged()) as shown:
        shown.page.set_input_files("#file", str(tmp_path / "mine.npz"))
        shown.until("page.motion?.name === 'mine.npz'")
        said = shown.page.inner_text("#odd")
        assert said.count("betas") == bool(whose)
        assert whose in said
        shown.moves_as_predicted(tmp_path / "mine.npz", -1, 0, body="embedded:female")
        joint_m = root_joint_m(open_clip_list(None, None).best.body, np.zeros(10))
        assert np.abs(joint_m).max() > 0  # else nothing would be turned about it
        assert shown.errors == []


HOSTILE = {
    "NaN": {"poses": np.full((5, 156), np.nan)},
    "radians": {"poses": np.full((5, 156), 400.0)},
    "shape": {"poses": np.zeros((5, 100))},
    "along neither y nor z": {"poses": np.pi / 4 * np.eye(156)[[0] * 5]},
    "beside": {"trans": np.zeros((4, 3))},
    "no person's": {"trans": np.full((5, 3), 1e5)},
    "metres": {"trans": np.full((5, 3), 90.0)},
    "frame rate": {"mocap_framerate": 0.0},
    "finite numbers": {"betas": np.array([{}] * 10, dtype=object)},
    "10 or more": {"betas": np.zeros(3)},
    "have shape 16,3,2": {"betas": np.zeros((16, 3, 2))},
    "two frame rates, 120 and 60": {"fps": 60.0},
    "by 'Rh'": {"Rh": np.zeros((5, 3))},
    "jumps at its frame 3": {"trans": np.repeat([[0.0], [9.0]], [3, 2], axis=0) * [1, 0, 0]},
    "jumps at its frame 1": {"poses": smplh()["poses"] + np.eye(5, 156, k=10)},
    "its frame 3 repeats the one before": {
        "trans": np.array([[0.0], [0.1], [0.2], [0.2], [0.3]]) * [1, 0, 0]
    },
    "a motion of": {"poses": np.zeros((40_000, 72)), "trans": np.zeros((40_000, 3)),
                    "mocap_framerate": 60.0},
    "larger than": {"betas": np.zeros(2_000_000)},
}  # fmt: skip


@pytest.mark.parametrize("words", HOSTILE)
def test_a_hostile_file_is_one_line_and_what_played_plays_on(file, tmp_path, words):
    np.savez_compressed(tmp_path / "a.npz", **{**smplh(), **HOSTILE[words]})
    before = file.page.evaluate("page.motion.name")
    said = dropped(file, tmp_path / "a.npz")
    assert words in said
    assert "\n" not in said
    assert file.page.evaluate("page.motion.name") == before


@pytest.mark.parametrize(
    ("name", "bytes_", "words"),
    [("a.glb", b"glTF", "need Python"), ("a.npz", b"PK\x03\x04broken", "damaged"),
     ("a.npz", b"", "no .npz"), ("a.bvh", b"HIERARCHY\n", "no line MOTION")],
)  # fmt: skip
def test_what_is_no_motion_is_one_line(file, tmp_path, name, bytes_, words):
    (tmp_path / name).write_bytes(bytes_)
    assert words in dropped(file, tmp_path / name)


_FAILS_ONCE = """const send = Worker.prototype.postMessage;
let failed = false;
Worker.prototype.postMessage = function (job, ...more) {
  const fails = !failed && job.job === "frame" && job.index === 3;
  failed ||= fails;
  return send.call(this, fails ? { ...job, index: NaN } : job, ...more);
};"""


def test_a_frame_that_failed_is_asked_for_again(browser):
    with (
        serve(packaged()) as address,
        open_page(browser, address, before=_FAILS_ONCE) as opened,
    ):
        shown = Shown(opened)
        shown.until("page.time > 4")
        assert shown.says() != ""


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        ("HTMLCanvasElement.prototype.getContext = () => null", "WebGL"),
        ("delete window.WebAssembly", "WebAssembly"),
    ],
)
def test_a_browser_that_cannot_is_told_so(browser, run, missing, words):
    with (
        serve(Scene(open_clip_list(run, None))) as address,
        open_page(browser, address, before=missing) as opened,
    ):
        opened.page.get_by_text(words).wait_for()
