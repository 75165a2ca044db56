"""Make the pictures of moving bodies in README and docs/gallery.md.

    python -m tools.build_gallery --run demo [--only landing.png gains.png] [--amass FILE]

`--run` is the run of `./reproduce.sh`: its DSNet, its DSNet+ and its simulated truth stand beside
each other; shapes and gains are of the packaged model. Nothing is written into the run. A motion of
AMASS (`--amass`) becomes a clip in `build/gallery/`, not in `docs/`: AMASS's licence does not let
others publish its motions.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bridge.errors import DsnetError
from bridge.export import gif
from bridge.runs import Run
from bridge.runs.processes import run_as_process
from bridge.runtime.characters import open_for_motion
from bridge.runtime.controls import Controls, controlled_body
from bridge.runtime.moving_body import MovingBody
from tools.gallery.laps import closed_lap
from tools.gallery.performed import (
    Performed,
    motion_of_kind,
    performed,
    sequence_of,
    shown_dsnet,
    true_performance,
)
from tools.gallery.stills import Look, Moment, draw_lying, draw_upright

ROOT = Path(__file__).parents[1]
PICTURES, UNPUBLISHED = ROOT / "docs" / "images" / "gallery", ROOT / "build" / "gallery"
SAMPLE = Path("sample:jumping_jacks")
_FRAMES_A_PICTURE = 3
"""Of a GIF: 20 pictures a second."""


@dataclass(frozen=True)
class Gallery:
    """What to make."""

    run: str = "demo"
    """Run whose predictors are shown."""
    only: tuple[str, ...] = ()
    """Names of pictures; all when left out."""
    amass: Path | None = None
    """A motion file of AMASS, for a clip that stays on this machine."""
    out: Path = PICTURES
    """Folder to write."""
    look: Look = field(default_factory=Look)
    """How large and how fine."""


def main(config: Gallery) -> None:
    """Make them, one after the other.

    Raises
    ------
    DsnetError
        If a picture's name is unknown, or the run lacks what it shows.
    """
    if unknown := set(config.only) - set(MAKERS):
        raise DsnetError(
            f"--only {' '.join(sorted(unknown))}", f"names among {', '.join(MAKERS)}", "Pass these."
        )
    config.out.mkdir(parents=True, exist_ok=True)
    for name in config.only or MAKERS:
        with tempfile.TemporaryDirectory() as folder:
            MAKERS[name](config, Path(folder) / name)
            print(shutil.move(Path(folder) / name, config.out / name))
    if config.amass is not None:
        print(real_motion(config, config.amass))


def jumping_jacks(config: Gallery, path: Path, kind: str = "jumping_jacks") -> None:
    """A clip of one round of a motion: SMPL alone, the run's DSNet, its best predictor."""
    run = Run(config.run)
    file, moving = motion_of_kind(run, kind), []
    for name in (shown_dsnet(run), None):
        character, motion = open_for_motion(run, name, file)
        one_round = replace(motion, theta=closed_lap(motion.theta, _FRAMES_A_PICTURE))
        moving.append(controlled_body(character, one_round, Controls(loop=True)))
    gif.write(path, *moving, body_px=config.look.body_px)


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


def real_motion(config: Gallery, file: Path) -> Path:
    """A clip of a recorded motion under the run's best predictor; returns where it is."""
    UNPUBLISHED.mkdir(parents=True, exist_ok=True)
    path = UNPUBLISHED / f"{file.stem}.gif"
    character, motion = open_for_motion(Run(config.run), None, file)
    gif.write(path, controlled_body(character, motion, Controls()), body_px=config.look.body_px)
    return path


MAKERS: dict[str, Callable[[Gallery, Path], None]] = {
    "jumping_jacks.gif": jumping_jacks,
    "landing.png": landing,
    "gravity.png": gravity,
    "shapes.png": shapes,
    "gains.png": gains,
}


def _beside_the_truth(run: Run, kind: str) -> tuple[list[Performed], MovingBody]:
    """SMPL alone, the run's DSNet, its best predictor and the truth; and one that moves so."""
    file = motion_of_kind(run, kind)
    best, motion = open_for_motion(run, None, file)
    dsnet, _ = open_for_motion(run, shown_dsnet(run), file)
    of = controlled_body(best, motion, Controls())
    bodies = [
        performed("SMPL alone", controlled_body(best, motion, Controls(gain=0.0))),
        performed(dsnet.chosen.label, controlled_body(dsnet, motion, Controls())),
        performed(best.chosen.label, of),
        true_performance(run, sequence_of(file), best.body),
    ]
    return bodies, of


def _draw_asked(config: Gallery, path: Path, asked: dict[str, Controls], title: str) -> None:
    """The sample motion by the packaged model, once for each label; the last decides when."""
    character, motion = open_for_motion(None, None, SAMPLE)
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
