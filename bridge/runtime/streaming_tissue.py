"""`dsnet_plus` one frame at a time, for characters that move while one watches; NumPy alone."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.paper import THETA_SIZE
from bridge.tissue.load import SkinnedNodes, in_rest_frame
from bridge.tissue.oscillators import FPS, OscillatorSheet
from bridge.tissue.trained_plus import TrainedPlus


class StreamingTissue:
    """The moving tissue of one character, from her poses as they come, 60 a second.

    What it gives is `latency_frames` old: the load of a step is smoothed over poses that lie so
    far ahead, and a model with `look_ahead` 0 has no latency.

    Parameters
    ----------
    model : a trained `dsnet_plus`.
    body : the body model that it was trained with.
    betas : (10,) the character's shape.
    """

    def __init__(self, model: TrainedPlus, body: BodyModelData, betas: NDArray) -> None:
        self.latency_frames = model.look_ahead
        self._skin = SkinnedNodes(body, model.nodes.vertices, betas)
        self._mechanics = model.mechanics(body, betas)
        self._sheet = OscillatorSheet(self._mechanics, model.nodes.laplacian)
        self._spread = model.nodes.spread
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next pose is one that the character has rested in."""
        self._skinned: deque[tuple[NDArray, NDArray]] = deque(maxlen=3)
        self._felt: deque[NDArray] = deque(maxlen=len(self._mechanics.taps))

    def step(self, theta: ArrayLike) -> NDArray[np.float32]:
        """Advance by one frame to the pose theta (69,).

        Returns
        -------
        ndarray
            (K, 3) offsets of the nodes in the rest pose, metres, of `latency_frames` ago;
            `spread` has those of all vertices.

        Raises
        ------
        DsnetError
            If theta has another shape.
        """
        theta = np.asarray(theta, np.float64)
        if theta.shape != (THETA_SIZE,):
            raise DsnetError(
                f"theta of shape {theta.shape}", f"({THETA_SIZE},)", "Pass one character's pose."
            )
        places, turns = self._skin(theta[None])
        if not self._skinned:
            self._begin(places, turns)
        self._skinned.append((places, turns))
        self._felt.appendleft(self._felt_before())
        load = sum(tap * f for tap, f in zip(self._mechanics.taps, self._felt, strict=True))
        felt = np.asarray(load, np.float32)
        self._now, self._before = self._sheet.frame(self._now, self._before, felt)
        return self._now

    def spread(self, at_nodes: NDArray) -> NDArray[np.float32]:
        """Offsets (K, 3) of the nodes to those of all vertices (V, 3)."""
        return self._spread(at_nodes[None])[0]

    def _begin(self, places: NDArray, turns: NDArray) -> None:
        self._skinned.extend([(places, turns)] * 2)
        at_rest = self._felt_of(np.zeros_like(places), turns)
        self._felt.extend([at_rest] * len(self._mechanics.taps))
        self._now = self._before = self._sheet.settled(at_rest)

    def _felt_before(self) -> NDArray:
        """(K, 3) load of the newest pose but one, m/s^2: the newest has no acceleration yet."""
        (oldest, _), (middle, turns), (newest, _) = self._skinned
        return self._felt_of((newest - 2 * middle + oldest) * FPS**2, turns)

    def _felt_of(self, acceleration: NDArray, turns: NDArray) -> NDArray:
        load = in_rest_frame(acceleration, turns)
        mechanics = self._mechanics
        felt = mechanics.inertia_gain * load.inertia + mechanics.gravity_gain * load.gravity
        return felt[0]
