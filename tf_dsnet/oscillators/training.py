"""Fitting the oscillators to aligned offsets by their error through time.

Windows of some frames are simulated from a given state and compared with the aligned offsets.
In the first rounds that state is the data's own, which teaches frequencies fast. Then it is the
model's, from a simulation of every clip that is made anew each round: errors that build up over
seconds count too, and noise of the data no longer enters as velocity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.options import NonNegativeInt, PositiveFloat, PositiveInt, Seed
from bridge.runtime.stepping import PlusModel, codes_of_several
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.oscillators import STEPS
from bridge.tissue.shape import shape_features, shaped_normals
from bridge.tissue.trained_plus import StaticPart, TrainedPlus, shares_of_people
from tf_dsnet.framework import be_reproducible, tf
from tf_dsnet.oscillators.clips import KnownPeople, NodeClip
from tf_dsnet.oscillators.layer import OscillatorLayer
from tf_dsnet.oscillators.learner import OscillatorLearner

_STATIC_ROUNDS = (1 / 3, 2 / 3, 1.0)
_CLIPS_AT_ONCE = 32
"""Simulated side by side."""


@dataclass(frozen=True)
class PlusSettings:
    """What a user may set about how `dsnet_plus` is trained."""

    seed: Seed = 0
    """Seed of the windows' order."""
    nodes: PositiveInt = 500
    """Vertices that carry the tissue; the others follow smoothly."""
    rounds: PositiveInt = 9
    """Rounds of training; each begins with a simulation of every clip."""
    steps: PositiveInt = 25
    """Adam's steps in a round."""
    window: PositiveInt = 36
    """Frames that a step simulates."""
    batch_size: PositiveInt = 12
    """Windows in a step."""
    lr: PositiveFloat = 0.06
    """Adam's learning rate at the start, for logarithms of coefficients; it falls to 0."""
    taps: PositiveInt = 3
    """Frames of the load that act on a step."""
    look_ahead: NonNegativeInt = 1
    """Frames by which the newest of them lies ahead of the step; 0 needs no later pose."""


class PlusTraining:
    """Oscillators, their optimizer, and the clips.

    Parameters
    ----------
    clips : what to train on.
    """

    def __init__(
        self,
        settings: PlusSettings,
        body: BodyModelData,
        nodes: TissueNodes,
        people: KnownPeople,
        clips: Sequence[NodeClip],
    ) -> None:
        be_reproducible(settings.seed)
        self.settings, self._body, self._nodes = settings, body, nodes
        self._people, self._clips = people, list(clips)
        self._features = np.stack([shape_features(body, b, nodes.vertices) for b in people.betas])
        self._normals = np.stack([shaped_normals(body, b)[nodes.vertices] for b in people.betas])
        self._shares = np.stack([shares_of_people(b, people.betas) for b in people.betas])
        self.layer = self.make_layer()
        self._learner = OscillatorLearner(self.layer, settings.lr)
        self.optimizer = self._learner.optimizer

    def round(self, number: int, static_m: Sequence[NDArray]) -> list[float]:
        """One round of steps against the offsets less a static part (T, K, 3) of each clip."""
        moving = [c.offsets_m - s for c, s in zip(self._clips, static_m, strict=True)]
        starts = self.starts(number, moving)
        return [
            self._one_step(number * self.settings.steps + step, moving, starts)
            for step in range(self.settings.steps)
        ]

    def make_layer(self) -> OscillatorLayer:
        """The oscillators before training."""
        laplacian = self._nodes.laplacian.toarray()
        return OscillatorLayer(laplacian, len(self._people.names), self.settings.taps)

    def starts(self, number: int, moving: list[NDArray]) -> list[NDArray]:
        """Offsets of the clips from which a round's windows set out: `moving` is the data's own."""
        return moving if number < self.settings.rounds // 3 else self.simulate()

    def static_rounds(self) -> set[int]:
        """How many rounds are done where the static part is fitted anew, if it helps."""
        return {round(part * self.settings.rounds) for part in _STATIC_ROUNDS}

    def simulate(self) -> list[NDArray[np.float32]]:
        """What the oscillators make of every clip, (T, K, 3) each."""
        model = PlusModel(self.trained(StaticPart.nothing()), self._body, threads=0)
        found = [np.empty_like(clip.offsets_m) for clip in self._clips]
        for start in range(0, len(found), _CLIPS_AT_ONCE):
            some = self._clips[start : start + _CLIPS_AT_ONCE]
            betas = self._people.betas[[clip.person for clip in some]]
            several = codes_of_several(model, [clip.theta for clip in some], betas)
            for frame, (rows, codes) in enumerate(several):
                for row, code in zip(rows, codes, strict=True):
                    found[start + row][frame] = code.T
        return found

    def trained(self, static: StaticPart) -> TrainedPlus:
        """The model as it is now."""
        weights = self.layer.weights_as_arrays()
        ahead = self.settings.look_ahead
        return TrainedPlus(self._nodes, weights, static, self._people.betas, ahead)

    def state(self) -> dict[str, NDArray]:
        """Copies of the layer's weights and the optimizer's moments."""
        variables = [*self.layer.weights, *self.optimizer.variables]
        return {variable.path: variable.numpy() for variable in variables}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Go back to what `state` returned, in this process or in an earlier one."""
        for variable in [*self.layer.weights, *self.optimizer.variables]:
            variable.assign(np.reshape(state[variable.path], variable.shape))

    def _one_step(self, step: int, moving: Sequence[NDArray], starts: Sequence[NDArray]) -> float:
        total = self.settings.rounds * self.settings.steps
        self.optimizer.learning_rate = self.settings.lr * (1 - step / total) ** 0.7
        rng = np.random.default_rng([self.settings.seed, step])
        count, size = len(self._clips), self.settings.batch_size
        rows = (
            rng.permutation(np.arange(size) % count)
            if count < size
            else rng.permutation(count)[:size]
        )
        windows = [self._window(int(row), rng) for row in rows]
        batch = {
            "now": np.stack([starts[r][f] for r, f in windows], 1),
            "before": np.stack([_a_step_before(starts[r], f) for r, f in windows], 1),
            "target": np.stack(
                [self._frames(moving[r], f + 1, self.settings.window) for r, f in windows], 2
            ),
            "counted": np.stack([self._counted(r, f) for r, f in windows], 2),
            "inertia": np.stack(
                [self._felt(self._clips[r].load.inertia, f) for r, f in windows], 2
            ),
            "gravity": np.stack(
                [self._felt(self._clips[r].load.gravity, f) for r, f in windows], 2
            ),
            "normals": np.stack([self._normals[self._clips[r].person] for r, _ in windows], 1),
            "features": np.stack([self._features[self._clips[r].person] for r, _ in windows], 1),
            "shares": np.stack([self._shares[self._clips[r].person] for r, _ in windows], 0),
        }
        return float(self._learner.step({k: tf.constant(v, tf.float32) for k, v in batch.items()}))

    def _window(self, row: int, rng: np.random.Generator) -> tuple[int, int]:
        last = max(len(self._clips[row]) - self.settings.window - 1, 2)
        return row, int(rng.integers(2, last + 1))

    def _counted(self, row: int, frame: int) -> NDArray:
        """(T, 1, 1) 1 for frames of a window that the clip has, 0 after its end."""
        frames = frame + 1 + np.arange(self.settings.window)
        return (frames < len(self._clips[row]))[:, None, None]

    def _felt(self, load: NDArray, frame: int) -> NDArray:
        """Loads of a window from the oldest tap of its first step on."""
        taps, ahead = self.settings.taps, self.settings.look_ahead
        return self._frames(load, frame + ahead - taps + 1, self.settings.window + taps - 1)

    @staticmethod
    def _frames(array: NDArray, start: int, count: int) -> NDArray:
        return array[np.clip(np.arange(start, start + count), 0, len(array) - 1)]


def _a_step_before(offsets_m: NDArray, frame: int) -> NDArray:
    """(K, 3) a step before a frame, on the parabola through it and the two before it."""
    now, before, earlier = offsets_m[frame], offsets_m[frame - 1], offsets_m[frame - 2]
    share = 1 / STEPS
    straight = now + share * (before - now)
    return straight - share * (1 - share) / 2 * (now - 2 * before + earlier)
