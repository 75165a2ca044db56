"""`dsnet_plus` learns: oscillators are fitted to aligned offsets by their error through time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from bridge.body import BodyModelData, load_paper_body
from bridge.errors import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.train_options import TrainPlusConfig
from bridge.exchange.weights import load_checkpoint, refuse_nonfinite, save_checkpoint
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import TRAIN_PLUS, best_alignment, body_model_path
from bridge.tissue.node_clips import NodeClip, known_people, node_clips
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.oscillators import STEPS
from bridge.tissue.shape import shape_features, shaped_normals
from bridge.tissue.static_part import NodeStatic, fit_static
from bridge.tissue.trained_plus import (
    NAME,
    StaticPart,
    TrainedPlus,
    Weights,
    shares_of_people,
)
from tf_dsnet.framework import Tensor, be_reproducible, tf
from tf_dsnet.oscillators import OscillatorLayer, OscillatorLearner

LABEL = "DSNet+, oscillators"
DEPARTURES = (
    "not the paper's network: damped oscillators on the skin, driven by inertia and gravity",
    "learned from the robust aligner's offsets",
)
_REMEDY = "Look at the alignment's offsets; a study may lower `TrainPlusConfig.lr`."
_STATIC_ROUNDS = (1 / 3, 2 / 3, 1.0)

Simulate = Callable[[TrainedPlus, BodyModelData, Sequence[NDArray], NDArray], list[NDArray]]
"""Offsets (T, K, 3) of the nodes that a model gives, without its static part, of motions theta
(T, 69) of a body, of people betas (B, 10): by the step that predictions repeat."""


class PlusTraining:
    """Oscillators and their optimizer, and the clips that they learn from, of people of `betas`
    (P, 10).

    Windows of some frames are simulated from a given state and compared with the aligned offsets.
    In the first rounds that state is the data's own, which teaches frequencies fast. Then it is the
    model's, from a simulation of every clip that is made anew each round: errors that build up over
    seconds count too, and noise of the data no longer enters as velocity.
    """

    def __init__(
        self,
        settings: TrainPlusConfig,
        body: BodyModelData,
        nodes: TissueNodes,
        betas: NDArray[np.float32],
        clips: Sequence[NodeClip],
        simulate: Simulate,
    ) -> None:
        be_reproducible(settings.seed)
        self.settings, self._body, self._nodes = settings, body, nodes
        self._betas, self._clips, self._simulate = betas, list(clips), simulate
        self._features = np.stack([shape_features(body, one, nodes.vertices) for one in betas])
        self._normals = np.stack([shaped_normals(body, one)[nodes.vertices] for one in betas])
        self._shares = np.stack([shares_of_people(one, betas) for one in betas])
        self.layer = self.make_layer()
        self._learner = OscillatorLearner(self.layer, settings.lr)

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
        return OscillatorLayer(laplacian, len(self._betas), self.settings.taps)

    def starts(self, number: int, moving: list[NDArray]) -> list[NDArray]:
        """Offsets of the clips from which a round's windows set out: `moving` is the data's own."""
        return moving if number < self.settings.rounds // 3 else self.simulate()

    def static_rounds(self) -> set[int]:
        """How many rounds are done where the static part is fitted anew, if it helps."""
        return {round(part * self.settings.rounds) for part in _STATIC_ROUNDS}

    def simulate(self) -> list[NDArray[np.float32]]:
        """What the oscillators make of every clip, (T, K, 3) each."""
        motions = [clip.theta for clip in self._clips]
        betas = self._betas[[clip.person for clip in self._clips]]
        return self._simulate(self.trained(StaticPart.nothing()), self._body, motions, betas)

    def trained(self, static: StaticPart) -> TrainedPlus:
        """The model as it is now."""
        weights = self.told_by_shape(self.layer.weights_as_arrays())
        ahead = self.settings.look_ahead
        return TrainedPlus(self._nodes, weights, static, self._betas, ahead)

    def told_by_shape(self, weights: Weights) -> Weights:
        """The same people, of whose differences as much as can be is told by their shapes."""
        return told_by_shape(weights, self._features)

    def state(self) -> dict[str, NDArray]:
        """Copies of the layer's weights and the optimizer's moments."""
        return {variable.path: variable.numpy() for variable in self._variables()}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Go back to what `state` returned, in this process or in an earlier one."""
        for variable in self._variables():
            variable.assign(state[variable.path])

    def _variables(self) -> list[Tensor]:
        return [*self.layer.weights, *self._learner.optimizer.variables]

    def constants_m(self, static: NodeStatic, offsets_m: NDArray) -> NDArray[np.float32]:
        """(P, V, 3) each person's mean of what nodes and pose leave of all offsets (F, V, 3)."""
        people = len(self._betas)
        sums, frames = np.zeros((people, *offsets_m.shape[1:])), np.zeros(people)
        if not static.constant_m.any():
            return sums.astype(np.float32)
        for clip, moving in zip(self._clips, self.simulate(), strict=True):
            by_pose = np.tensordot(clip.features, static.by_pose_m, 1)
            at_nodes = (moving + by_pose).mean(axis=0, keepdims=True)
            own = np.asarray(offsets_m[clip.sequence.frames]).mean(axis=0, dtype=np.float64)
            sums[clip.person] += len(clip) * (own - self._nodes.spread(at_nodes)[0])
            frames[clip.person] += len(clip)
        return (sums / frames[:, None, None]).astype(np.float32)

    def _one_step(self, step: int, moving: Sequence[NDArray], starts: Sequence[NDArray]) -> float:
        total = self.settings.rounds * self.settings.steps
        self._learner.optimizer.learning_rate = self.settings.lr * (1 - step / total) ** 0.7
        windows = [
            self._window(self._clips[row], frame, moving[row], starts[row])
            for row, frame in self._drawn(step)
        ]
        # Several people side by side, before the coordinates.
        batch = {name: np.stack([one[name] for one in windows], -2) for name in windows[0]}
        return float(self._learner.step({k: tf.constant(v, tf.float32) for k, v in batch.items()}))

    def _drawn(self, step: int) -> Iterator[tuple[int, int]]:
        """Clips of the windows of a step, and the frames that these set out from."""
        count, size = len(self._clips), self.settings.batch_size
        rng = np.random.default_rng([self.settings.seed, step])
        of_few = count < size
        rows = rng.permutation(np.arange(size) % count if of_few else count)[:size]
        for row in rows.tolist():
            last = max(len(self._clips[row]) - self.settings.window - 1, 2)
            yield row, int(rng.integers(2, last + 1))

    def _window(
        self, clip: NodeClip, frame: int, moving: NDArray, start: NDArray
    ) -> dict[str, NDArray]:
        """What is simulated and compared from a frame on. The first and the last load of a clip
        stand for those that there are not; offsets after its end are not counted."""
        window, ahead = self.settings.window, self.settings.look_ahead
        after = frame + 1 + np.arange(window)
        felt = frame + np.arange(ahead - self.settings.taps + 1, ahead + window)
        return {
            "now": start[frame],
            "before": _a_step_before(start, frame),
            "target": moving.take(after, 0, mode="clip"),
            "counted": (after < len(clip))[:, None, None],
            "inertia": clip.load.inertia.take(felt, 0, mode="clip"),
            "gravity": clip.load.gravity.take(felt, 0, mode="clip"),
            "normals": self._normals[clip.person],
            "features": self._features[clip.person],
            "shares": self._shares[clip.person],
        }


def told_by_shape(weights: Weights, features: NDArray) -> Weights:
    """Least squares of what people have of log W on their `features` (P, K, 3), soft nodes first.

    Training gives every node of every person a number of her own sooner than it finds what all of
    them follow, and new people have none. Known ones stay as they are.
    """
    own = (features @ weights.slopes + weights.residual).astype(np.float64)
    apart, differences = features - features.mean(0), own - own.mean(0)
    softness = np.exp(-weights.base["omega"].astype(np.float64))
    rows = (softness * apart).reshape(-1, features.shape[-1])
    ridge = 1e-2 * np.square(rows).sum() / rows.shape[1] * np.eye(rows.shape[1])
    right = rows.T @ (softness * differences).reshape(-1, 1)
    # From one person, or from equal ones, nobody can tell what shape does.
    slopes = np.linalg.solve(rows.T @ rows + ridge, right) if rows.any() else 0 * right
    shared = own.mean(0) - features.mean(0) @ slopes
    powers = weights.powers()
    base = {n: log + np.float32(powers.get(n, 0.0)) * shared for n, log in weights.base.items()}
    return replace(
        weights,
        base={name: log.astype(np.float32) for name, log in base.items()},
        slopes=slopes.astype(np.float32),
        residual=(differences - apart @ slopes).astype(np.float32),
    )


def _a_step_before(offsets_m: NDArray, frame: int) -> NDArray:
    """(K, 3) a step before a frame, on the parabola through it and the two before it."""
    now, before, earlier = offsets_m[frame], offsets_m[frame - 1], offsets_m[frame - 2]
    share = 1 / STEPS
    straight = now + share * (before - now)
    return straight - share * (1 - share) / 2 * (now - 2 * before + earlier)


def train_plus(
    config: TrainPlusConfig, simulate: Simulate, training: type[PlusTraining] = PlusTraining
) -> None:
    """Make `train_plus`: a result that is current is kept, one that was interrupted is continued.

    A study that trains in another way hands over a configuration and a training of its own.
    """
    run = Run(config.run)
    align, body_path = best_alignment(run), body_model_path(run)
    make = partial(_make, config, partial(training, simulate=simulate), align, body_path)
    run.build(TRAIN_PLUS, config, make, data=align.origin, upstream={align.path.name: align})


def _make(
    config: TrainPlusConfig,
    make_training: Callable[..., PlusTraining],
    align: Artifact,
    body_path: Path,
    writer: ArtifactWriter,
) -> None:
    """One training, with a checkpoint after every round."""
    body = load_paper_body(str(body_path))
    nodes, (people, betas) = TissueNodes.of(body, config.nodes), known_people(align)
    clips = node_clips(align, body, nodes, people, betas)
    training = make_training(config, body, nodes, betas, clips)
    losses: list[float] = []
    static = NodeStatic.nothing(len(people), clips[0].features.shape[1], len(nodes))
    checkpoint = writer.checkpoints / f"{NAME}.safetensors"
    if (state := load_checkpoint(checkpoint)) is not None:
        losses = state["history/loss"].tolist()
        static = NodeStatic(state["static/constant"], state["static/by_pose"])
        training.restore(state)
    done = len(losses) // config.steps
    bar = tqdm(range(done, config.rounds), desc=NAME, unit="round", disable=None, initial=done,
               total=config.rounds)  # fmt: skip
    for number in bar:
        losses += training.round(number, [static.of(clip) for clip in clips])
        if not np.isfinite(losses[-1]):
            received = f"{NAME} with a loss of {losses[-1]} in round {number + 1}"
            raise DsnetError(received, "a number", _REMEDY)
        if number + 1 in training.static_rounds():
            static = fit_static(clips, training.simulate(), len(people))
        so_far = {
            "history/loss": np.array(losses),
            "static/constant": static.constant_m,
            "static/by_pose": static.by_pose_m,
        }
        save_checkpoint(checkpoint, {**training.state(), **so_far})
        bar.set_postfix(loss=losses[-1])
    constants_m = training.constants_m(static, align.array("offsets"))
    trained = training.trained(StaticPart(constants_m, static.by_pose_m))
    refuse_nonfinite(trained.arrays(), NAME, _REMEDY)
    save_weights(writer.file_path(f"{NAME}.safetensors"), trained.arrays())
    unit = "share of the windows' energy, and of quiet ones"
    writer.put(f"loss_{NAME}", np.array(losses, np.float32), unit)
    writer.record(
        predictors={NAME: {"label": LABEL, "departures": list(DEPARTURES)}},
        default=NAME,
        people=people,
        static=static.kind,
    )
