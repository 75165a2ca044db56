"""A body in motion by the model that comes with the package, and what it does frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dsnet.prediction.load_model import TrainedModel, load_model
from dsnet.prediction.moving_body import MovingBody, place_motion
from tests.forged.amass import load_amass_motion

FRAMES = 66
"""More than one piece."""


@dataclass(frozen=True, eq=False)
class Performed:
    """A moving body and all of its frames."""

    moving: MovingBody
    offsets_m: NDArray[np.float32]
    vertices_m: NDArray[np.float32]


@pytest.fixture(scope="session")
def character() -> TrainedModel:
    return load_model(None, gender="female")


def moving_body(character: TrainedModel, frames: int) -> MovingBody:
    """The sample of jumping jacks, once they are under way."""
    motion = load_amass_motion("sample:jumping_jacks")
    motion = replace(motion, theta=motion.theta[30 : 30 + frames])
    return MovingBody(character, place_motion(motion, character.body))


@pytest.fixture(scope="session")
def performed(character: TrainedModel) -> Performed:
    moving = moving_body(character, FRAMES)
    pieces = list(moving)
    assert len(pieces) > 1
    return Performed(
        moving,
        np.concatenate([piece.offsets_m for piece in pieces]),
        np.concatenate([piece.vertices_m for piece in pieces]),
    )
