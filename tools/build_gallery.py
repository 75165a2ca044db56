"""Make the pictures of moving bodies in README and docs/gallery.md.

    python -m tools.build_gallery --run demo [--only landing.png gains.png]
    python -m tools.build_gallery --run demo --recording FILE [--only recorded_jumps.gif]

`--run` is the run of `./reproduce.sh`: its DSNet, its DSNet+ and its simulated truth stand beside
each other; shapes and gains are of the packaged model. Nothing is written into the run.

A recorded motion (`--recording`, AMASS's or a BVH) becomes a clip in `build/gallery/`, not in
`docs/`: AMASS's licence does not let others publish its motions. The only one that goes into
`docs/` is `recorded_jumps.gif`, if it is asked for by name, of the one file whose makers allow it.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import run_as_process
from bridge.errors import DsnetError
from bridge.motion import load_motion
from bridge.runs import Run
from dsnet.exporters.clips import write_gif
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.moving_body import MovingBody
from tools.gallery.laps import best_lap, closed, closed_lap
from tools.gallery.performed import (
    Performed,
    TrueBody,
    motion_of_kind,
    performed,
    sequence_of,
    shown_dsnet,
    true_performance,
    truth_of,
)
from tools.gallery.stills import Look, Moment, draw_lying, draw_upright

ROOT = Path(__file__).parents[1]
PICTURES, UNPUBLISHED = ROOT / "docs" / "images" / "gallery", ROOT / "build" / "gallery"
SAMPLE = Path("sample:jumping_jacks")
_FRAMES_A_PICTURE = 3
"""Of a GIF: 20 pictures a second."""
RECORDED = "recorded_jumps.gif"
FREE_FILE, FREE_OF = "01_01.bvh", "CMU, subject 01, motion 01"
"""The recording that it shows. CMU lets everybody copy, change and hand on its motions."""
_JUMPS = slice(165, 345)
"""Two of its jumps, at 60 fps; after them she stands as before, within 10 degrees and 4 mm."""
_SMOOTH_HZ = "auto"
"""Recordings tremble, which shakes flesh."""


@dataclass(frozen=True)
class Gallery:
    """What to make."""

    run: str = "demo"
    """Run whose predictors are shown."""
    only: tuple[str, ...] = ()
    """Names of pictures; when left out all but that of a recording, or with --recording none."""
    recording: Path | None = None
    """A recorded motion, for a clip that stays on this machine; with --only recorded_jumps.gif the
    file that is shown there."""
    out: Path = PICTURES
    """Folder to write."""
    look: Look = field(default_factory=Look)
    """How large and how fine."""


def main(config: Gallery) -> None:
    """Make them, one after the other.

    Raises
    ------
    DsnetError
        If a picture's name is unknown, or the run or the recording is not one that it shows.
    """
    if unknown := set(config.only) - set(MAKERS):
        raise DsnetError(
            f"--only {' '.join(sorted(unknown))}", f"names among {', '.join(MAKERS)}", "Pass these."
        )
    of_a_run = [name for name in MAKERS if name != RECORDED]
    for name in config.only or (of_a_run if config.recording is None else ()):
        _make(config, config.out / name, MAKERS[name])
    if config.recording is not None and RECORDED not in config.only:
        clip = partial(recorded_motion, file=config.recording)
        _make(config, UNPUBLISHED / f"{config.recording.stem}.gif", clip)


def _make(config: Gallery, path: Path, maker: Callable[[Gallery, Path], None]) -> None:
    """One picture, whole or not at all."""
    with tempfile.TemporaryDirectory() as folder:
        maker(config, Path(folder) / path.name)
        path.parent.mkdir(parents=True, exist_ok=True)
        print(shutil.move(Path(folder) / path.name, path))


def jumping_jacks(config: Gallery, path: Path, kind: str = "jumping_jacks") -> None:
    """A clip of one round of a motion: SMPL alone, the run's DSNet, its best predictor, truth."""
    run = Run(config.run)
    file = motion_of_kind(run, kind)
    lap = partial(closed_lap, multiple=_FRAMES_A_PICTURE)
    moving = _moved(config, file, lap, Controls(loop=True))
    truth = truth_of(run, sequence_of(file))
    round_m = closed(truth.offsets_m, best_lap(truth.theta, _FRAMES_A_PICTURE))
    # Four bodies are as wide as three were.
    body_px = config.look.body_px * 3 // 8 * 2
    write_gif(path, *moving, TrueBody(moving[0], round_m), body_px=body_px)


def recorded_jumps(config: Gallery, path: Path) -> None:
    """Two jumps that somebody really did, of the one recording that may be shown here."""
    if config.recording is None or config.recording.name != FREE_FILE:
        raise DsnetError(
            f"--only {RECORDED} with --recording {config.recording}",
            f"CMU's {FREE_FILE}, which may be handed on",
            f"Pass --recording {FREE_FILE}, or leave out --only: a clip of another recording goes "
            "to build/gallery.",
        )
    recorded_motion(config, path, config.recording, shown=_JUMPS, recorded=FREE_OF)


def recorded_motion(
    config: Gallery,
    path: Path,
    file: Path,
    shown: slice = slice(None),
    recorded: str = "",
    person_of: str = "jumping_jacks",
) -> None:
    """A recorded motion as a clip: SMPL alone, the run's DSNet, its best predictor.

    Parameters
    ----------
    file : AMASS's or a BVH.
    shown : frames of it at 60 fps; before them nothing has moved.
    recorded : whose it is; its file's name when empty.
    person_of : kind of the run's test motion whose person moves so.
    """
    person = load_motion(motion_of_kind(Run(config.run), person_of))
    betas = ",".join(f"{beta:g}" for beta in person.betas)
    asked = Controls(betas=betas, floor="shift", smooth_hz=_SMOOTH_HZ)
    moving = _moved(config, file, itemgetter(shown), asked)
    # Even, and smaller than of a lap: three seconds have twice as many pictures.
    body_px = config.look.body_px * 3 // 7 * 2
    write_gif(path, *moving, body_px=body_px, recorded=recorded or file.name)


def landing(config: Gallery, path: Path, kind: str = "jumping_jacks") -> None:
    """The moment of a jump in which the true skin is farthest from SMPL's."""
    bodies, of = _beside_the_truth(Run(config.run), kind)
    moment = Moment(bodies, _most(bodies[-1]), of, "Landing from a jumping jack")
    draw_upright(path, moment, config.look)


def gravity(config: Gallery, path: Path, kind: str = "lying_down_and_getting_up") -> None:
    """Somebody who lies: the load on the tissue is gravity's, in another direction than upright."""
    bodies, of = _beside_the_truth(Run(config.run), kind)
    heights_m = np.ptp(bodies[-1].vertices_m[..., 1], axis=1)
    # Between coming to lie and getting up, when all has come to rest.
    frame = int(np.median(np.flatnonzero(heights_m < heights_m.min() + 0.02)))
    moment = Moment(bodies, frame, of, "Lying: gravity pulls another way")
    draw_lying(path, moment, config.look)


def shapes(config: Gallery, path: Path) -> None:
    """One motion, four bodies, the packaged model."""
    words = {"average": (), "slim": ("slim",), "tall": ("tall",), "heavy": ("heavy",)}
    asked = {word: Controls(shape=shape, floor="shift") for word, shape in words.items()}
    _draw_asked(config, path, asked, "One motion, four bodies")


def gains(config: Gallery, path: Path) -> None:
    """One moment with the dynamics left out, as predicted, and doubled; the packaged model."""
    labels = {0.0: "--gain 0", 1.0: "as predicted", 2.0: "--gain 2"}
    asked = {
        label: Controls(gain=gain, shape=("heavy",), floor="shift")
        for gain, label in labels.items()
    }
    _draw_asked(config, path, asked, "The gain multiplies the skin's dynamics")


MAKERS: dict[str, Callable[[Gallery, Path], None]] = {
    "jumping_jacks.gif": jumping_jacks,
    RECORDED: recorded_jumps,
    "landing.png": landing,
    "gravity.png": gravity,
    "shapes.png": shapes,
    "gains.png": gains,
}


def _moved(
    config: Gallery, file: Path, part: Callable[[NDArray], NDArray], controls: Controls
) -> list[MovingBody]:
    """A part of a motion (T, 69), by the run's DSNet and by its best predictor."""
    run, moving = Run(config.run), []
    for name in (shown_dsnet(run), None):
        character, motion = controls.load(run, name, file)
        motion = replace(motion, theta=part(motion.theta))
        moving.append(controlled_body(character, motion, controls))
    return moving


def _beside_the_truth(run: Run, kind: str) -> tuple[list[Performed], MovingBody]:
    """SMPL alone, the run's DSNet, its best predictor and the truth; and one that moves so."""
    file = motion_of_kind(run, kind)
    best, motion = Controls().load(run, None, file)
    dsnet, _ = Controls().load(run, shown_dsnet(run), file)
    of = controlled_body(best, motion, Controls())
    bodies = [
        performed("SMPL alone", controlled_body(best, motion, Controls(gain=0.0))),
        performed(dsnet.label, controlled_body(dsnet, motion, Controls())),
        performed(best.label, of),
        true_performance(run, sequence_of(file), best.body),
    ]
    return bodies, of


def _draw_asked(config: Gallery, path: Path, asked: dict[str, Controls], title: str) -> None:
    """The sample motion by the packaged model, once for each label; the last decides when."""
    character, motion = Controls().load(None, None, SAMPLE)
    moving = {label: controlled_body(character, motion, c) for label, c in asked.items()}
    bodies = [performed(label, one) for label, one in moving.items()]
    of = next(iter(moving.values()))
    draw_upright(path, Moment(bodies, _most(bodies[-1]), of, title), config.look)


def _most(body: Performed) -> int:
    """The frame in which the skin's offsets are largest, once the motion is under way."""
    begun = len(body.sizes_m) // 3
    return begun + int(body.sizes_m[begun:].mean(axis=1).argmax())


if __name__ == "__main__":
    run_as_process(Gallery, main)
