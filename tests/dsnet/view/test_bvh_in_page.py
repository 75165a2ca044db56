"""A page from a disk reads the BVHs that Python reads as Python does, or says in a line why not."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.motion import AS_IT_SAYS
from tests.dsnet.view.pages import Shown, on_disk, packaged, read_by_page
from tests.forged.bvh import Skeleton, text, world_of
from tests.forged.motion_kinds import KINDS, Kind
from tests.forged.walks import (
    HANGING,
    MIXAMO,
    REST_CM,
    SMPL_PARENTS,
    about,
    along_x,
    bvh,
    turned,
    walk,
)
from tools.headless_chromium import why_missing

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_missing() is not None, reason=why_missing() or ""),
]
MOST_DEG, MOST_M = 1e-6, 1e-9
MENDED = {"LeftToeBase.bvh", "RightHand.bvh", "Head.bvh", "Spine1.bvh", "RightLeg.bvh", "leap.bvh",
          "repeats.bvh", "cut.bvh"}  # fmt: skip
"""What Python mends or divides, and a page refuses."""


@pytest.fixture(scope="module")
def file(browser, tmp_path_factory) -> Iterator[Shown]:
    with on_disk(browser, tmp_path_factory.mktemp("page") / "a.html", packaged()) as shown:
        yield shown
        assert shown.errors == []


def _walk(
    names: list[str] | tuple[str, ...] = MIXAMO,
    fps: float = 60.0,
    *,
    places: Callable[[np.ndarray], np.ndarray] = lambda places_cm: places_cm,
    rest_first: bool = False,
) -> str:
    """The walk at another rate, on another path, or out of a T."""
    pose, places_m = walk()
    world = world_of(pose)
    if rest_first:
        world[0] = np.eye(3)
    return text(Skeleton(names, SMPL_PARENTS, REST_CM), world, places(100 * places_m), fps)


def _moved(step_cm: float, first: int, last: int) -> Callable[[np.ndarray], np.ndarray]:
    def moved(places_cm: np.ndarray) -> np.ndarray:
        places_cm = places_cm.copy()
        places_cm[first:last, 0] += step_cm
        return places_cm

    return moved


def _repeats() -> str:
    lines = bvh().splitlines()
    lines[-40] = lines[-41]
    return "\n".join([*lines, ""])


_LIES = {joint: about("y", 30) @ about("x", -90) for joint in range(24)}
OTHERS = (
    *(Kind(f"{fps:g}_hz.bvh", "", lambda fps=fps: _walk(fps=fps)) for fps in (24, 59.94, 90, 240)),
    *(Kind(f"from_t_{fps}.bvh", "", lambda fps=fps: _walk(fps=fps, rest_first=True))
      for fps in (25, 120)),
    Kind("a_turned.bvh", "", lambda: bvh(
        frames={n: about("y", 30) @ HANGING.get(n, np.eye(3)) for n in range(24)})),
    Kind("lies.bvh", "", lambda: bvh(frames=_LIES)),
    Kind("lies_in_its_world.bvh", "", lambda: bvh(world=about("x", 50))),
    Kind("twisted_frames.bvh", "", lambda: bvh(frames=along_x(legs=90, arms=-90, forearms=180))),
    Kind("mirrored.bvh", "", lambda: bvh(SMPL_JOINT_NAMES, turned(30), about("x", 90), True)),
    Kind("no_names.bvh", "", lambda: _walk([f"tail{n}" for n in range(24)])),
    Kind("leap.bvh", "", lambda: _walk(places=_moved(11, 40, 42))),
    Kind("leaps_away.bvh", "", lambda: _walk(places=_moved(11, 40, 90))),
    Kind("cut.bvh", "", lambda: _walk(places=_moved(80, 40, 90))),
    Kind("far.bvh", "", lambda: _walk(places=_moved(1e6, 0, 90))),
    Kind("repeats.bvh", "", _repeats),
)  # fmt: skip
OF_BVH = [kind for kind in (*KINDS, *OTHERS) if kind.file.lower().endswith(".bvh")]


@pytest.mark.parametrize("kind", OF_BVH, ids=lambda kind: kind.file)
def test_a_bvh_is_read_as_python_reads_it_or_refused(file: Shown, kind: Kind, tmp_path: Path):
    path = replace(kind, fps=None, how=AS_IT_SAYS).write(tmp_path)
    found, expected = read_by_page(file, path), _by_python(path)
    if expected is None or kind.file in MENDED:
        assert "\n" not in found["refused"]
        assert expected is None or "dsnet view" in found["refused"]
        return
    assert "refused" not in found
    theta = np.reshape(found["theta"], (-1, 69))
    one, two = (Rotation.from_rotvec(t[:, :66].reshape(-1, 3)) for t in (theta, expected.theta))
    assert np.degrees((one.inv() * two).magnitude()).max() < MOST_DEG
    np.testing.assert_allclose(theta[:, 66:], expected.trans_m, atol=MOST_M)
    assert len(found["says"]) == len(expected.notes) + bool(expected.rest_pose_frames)


def _by_python(path: Path) -> Motion | None:
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            return load_motion(path)
    except DsnetError:
        return None


def test_a_dropped_bvh_plays_as_predicted(file: Shown, tmp_path: Path):
    (tmp_path / "walk.bvh").write_text(bvh(frames=HANGING))
    file.page.set_input_files("#file", str(tmp_path / "walk.bvh"))
    file.until("page.motion?.name === 'walk.bvh'")
    file.moves_as_predicted(tmp_path / "walk.bvh", -1, 0, body="embedded:female")
