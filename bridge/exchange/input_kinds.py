"""What a DSNet is told of a motion at each frame: the pose itself, or only how it changes.

The paper gives DSNet betas and theta (Section 5), 79 numbers. Where the pose is new to it such a
network is lost, for it has learned the places of motions with them (docs/findings.md); how a pose
changes is what loads tissue, wherever it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.paper import INPUT_SIZE, N_BETAS, THETA_SIZE

CHANGE_FRAMES = 6
"""Differences are scaled to what they amount to in 0.1 s at 60 fps, which brings them to the size
of poses: rad and m. One least spread then suits all inputs: a joint that hardly moved in training
is not magnified until a motion in which it does is beyond all bounds."""
CHANGE_S = CHANGE_FRAMES / 60


@dataclass(frozen=True)
class InputKind:
    """One choice of inputs."""

    name: str
    size: int
    """Numbers at each frame."""
    of: Callable[[NDArray], NDArray]
    """From a motion's betas and theta (T, ..., 79), as `join_inputs` gives them, to
    (T, ..., size)."""


def _poses(joined: NDArray) -> NDArray:
    return joined


def _differences(joined: NDArray) -> NDArray:
    """Betas, theta_t - theta_{t-1} and the difference of that; 0 while there is no past."""
    betas, theta = joined[..., :N_BETAS], joined[..., N_BETAS:]
    first, second = np.zeros_like(theta), np.zeros_like(theta)
    first[1:] = np.diff(theta, axis=0)
    second[2:] = np.diff(theta, n=2, axis=0)
    return np.concatenate([betas, CHANGE_FRAMES * first, CHANGE_FRAMES**2 * second], axis=-1)


POSES = InputKind("poses", INPUT_SIZE, _poses)
"""Betas and theta: the paper's."""
DIFFERENCES = InputKind("pose differences", N_BETAS + 2 * THETA_SIZE, _differences)
"""Betas, and theta's first and second differences."""


def input_kind_of(weights: Mapping[str, NDArray]) -> InputKind:
    """The kind that a network's first layer was made for.

    Raises
    ------
    DsnetError
        If it was made for none.
    """
    size = weights["fc_enc_1/kernel"].shape[0] if "fc_enc_1/kernel" in weights else 0
    for kind in (POSES, DIFFERENCES):
        if kind.size == size:
            return kind
    raise DsnetError(
        f"a network of {size} inputs",
        f"{POSES.size} ({POSES.name}) or {DIFFERENCES.size} ({DIFFERENCES.name})",
        "Pass weights written by `dsnet train`.",
    )
