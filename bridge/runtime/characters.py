"""A body that a trained predictor moves: of a run, or of the package."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bridge.body import BodyModelData, load_body_model
from bridge.motion import Motion, load_motion_file
from bridge.motion.smoothing import SmoothHz
from bridge.runs import Run
from bridge.runtime.dsnet_step import DSNET
from bridge.runtime.motion_predictor import Chosen, choose_predictor
from bridge.runtime.packaged import packaged_predictor
from bridge.runtime.plus_step import PLUS
from bridge.runtime.stepping import MotionPredictor, WholeMotions

ROADS = (PLUS, DSNET)
"""Whose predictors can be asked for, the best first."""


@dataclass(frozen=True, eq=False)
class Character:
    """A body model, and the predictor of its offsets."""

    chosen: Chosen
    body: BodyModelData
    predict: MotionPredictor

    @classmethod
    def of(cls, chosen: Chosen) -> Character:
        """Load body and predictor.

        Raises
        ------
        DsnetError
            If a file of theirs is damaged.
        """
        body = load_body_model(chosen.body_model)
        return cls(chosen, body, WholeMotions(chosen.open(body)))


def choose(run: Run | None, predictor: str | None = None, gender: str = "unknown") -> Chosen:
    """A predictor of a run; without one, that of the package.

    Parameters
    ----------
    run : whose predictor; None for the packaged model.
    predictor : its name; the best there is when None.
    gender : of the packaged body.

    Raises
    ------
    DsnetError
        If there is no such predictor, or what it is made of is no chain.
    """
    if run is None:
        return packaged_predictor(gender, predictor)
    return choose_predictor(run, predictor, ROADS)


def open_character(
    run: Run | None, predictor: str | None = None, gender: str = "unknown"
) -> Character:
    """The character that `choose` names, loaded.

    Raises
    ------
    DsnetError
        If there is none, or a file of hers is damaged.
    """
    return Character.of(choose(run, predictor, gender))


def open_for_motion(
    run: Run | None,
    predictor: str | None,
    path: Path,
    motion_fps: float | None = None,
    smooth_hz: SmoothHz | None = None,
) -> tuple[Character, Motion]:
    """The character that `choose` names, and the motion of a file as it has it.

    `motion_fps` is the file's rate, where what it says of itself is wrong; what is faster than
    `smooth_hz` is left out.

    Without a run she is of the motion's gender; a run that cannot predict is told before the file
    is read.

    Raises
    ------
    DsnetError
        If there is no such character, or the file is no motion.
    """
    character = None if run is None else open_character(run, predictor)
    motion = load_motion_file(path, motion_fps, smooth_hz=smooth_hz)
    return character or open_character(None, predictor, motion.gender), motion
