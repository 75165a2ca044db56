"""Training of `dsnet_plus`: its oscillators are fitted to aligned offsets by backpropagation."""

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
    """Oscillators and their optimizer, and the training clips, of people with `betas` (P, 10).

    Windows of some frames are simulated from an initial state and compared with the aligned
    offsets. In the first rounds the initial state is the data's, by which frequencies are learned
    fast. Later it is the model's, by a simulation of every clip at the start of the round, so that
    errors that build up over seconds count too, and noise of the data does not become velocity.
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
        """Train a round of steps on the offsets without the clips' static parts (T, K, 3)."""
        dynamic = [c.offsets_m - s for c, s in zip(self._clips, static_m, strict=True)]
        starts = self.starts(number, dynamic)
        return [
            self._one_step(number * self.settings.steps + step, dynamic, starts)
            for step in range(self.settings.steps)
        ]

    def make_layer(self) -> OscillatorLayer:
        """The oscillators before training."""
        laplacian = self._nodes.laplacian.toarray()
        return OscillatorLayer(laplacian, len(self._betas), self.settings.taps)

    def starts(self, number: int, dynamic: list[NDArray]) -> list[NDArray]:
        """Offsets of the clips that give a round's initial states; `dynamic` are the data's."""
        return dynamic if number < self.settings.rounds // 3 else self.simulate()

    def static_rounds(self) -> set[int]:
        """Numbers of rounds after which the static part is fitted again."""
        return {round(part * self.settings.rounds) for part in _STATIC_ROUNDS}

    def simulate(self) -> list[NDArray[np.float32]]:
        """Simulated offsets (T, K, 3) of every clip."""
        motions = [clip.theta for clip in self._clips]
        betas = self._betas[[clip.person for clip in self._clips]]
        return self._simulate(self.trained(StaticPart.nothing()), self._body, motions, betas)

    def trained(self, static: StaticPart) -> TrainedPlus:
        """The model with the present weights."""
        weights = self.explained_by_shape(self.layer.weights_as_arrays())
        look_ahead = self.settings.look_ahead
        return TrainedPlus(self._nodes, weights, static, self._betas, look_ahead)

    def explained_by_shape(self, weights: Weights) -> Weights:
        """The same weights, with differences between people explained by shape where possible."""
        return explained_by_shape(weights, self._features)

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
        """Mean (P, V, 3) of each person's offsets (F, V, 3) less what nodes and pose explain."""
        people = len(self._betas)
        sums, frames = np.zeros((people, *offsets_m.shape[1:])), np.zeros(people)
        if not static.constant_m.any():
            return sums.astype(np.float32)
        for clip, simulated in zip(self._clips, self.simulate(), strict=True):
            by_pose = np.tensordot(clip.features, static.by_pose_m, 1)
            at_nodes = (simulated + by_pose).mean(axis=0, keepdims=True)
            mean = np.asarray(offsets_m[clip.sequence.frames]).mean(axis=0, dtype=np.float64)
            sums[clip.person] += len(clip) * (mean - self._nodes.spread(at_nodes)[0])
            frames[clip.person] += len(clip)
        return (sums / frames[:, None, None]).astype(np.float32)

    def _one_step(self, step: int, dynamic: Sequence[NDArray], starts: Sequence[NDArray]) -> float:
        total = self.settings.rounds * self.settings.steps
        self._learner.optimizer.learning_rate = self.settings.lr * (1 - step / total) ** 0.7
        windows = [
            self._window(self._clips[row], frame, dynamic[row], starts[row])
            for row, frame in self._drawn(step)
        ]
        # The axis of the batch is the last but one, before the coordinates.
        batch = {name: np.stack([one[name] for one in windows], -2) for name in windows[0]}
        return float(self._learner.step({k: tf.constant(v, tf.float32) for k, v in batch.items()}))

    def _drawn(self, step: int) -> Iterator[tuple[int, int]]:
        """The windows of a step: rows of their clips, and the frames before them."""
        count, size = len(self._clips), self.settings.batch_size
        rng = np.random.default_rng([self.settings.seed, step])
        rows = rng.permutation(np.arange(size) % count if count < size else count)[:size]
        for row in rows.tolist():
            last = max(len(self._clips[row]) - self.settings.window - 1, 2)
            yield row, int(rng.integers(2, last + 1))

    def _window(
        self, clip: NodeClip, frame: int, dynamic: NDArray, start: NDArray
    ) -> dict[str, NDArray]:
        """The part of a batch of one window, which starts after a frame.

        Loads before and after a clip are its first and last ones; frames after its end do not
        count.
        """
        window, look_ahead = self.settings.window, self.settings.look_ahead
        after = frame + 1 + np.arange(window)
        loads = frame + np.arange(look_ahead - self.settings.taps + 1, look_ahead + window)
        return {
            "now": start[frame],
            "before": _a_step_before(start, frame),
            "target": dynamic.take(after, 0, mode="clip"),
            "counted": (after < len(clip))[:, None, None],
            "inertia": clip.load.inertia.take(loads, 0, mode="clip"),
            "gravity": clip.load.gravity.take(loads, 0, mode="clip"),
            "normals": self._normals[clip.person],
            "features": self._features[clip.person],
            "shares": self._shares[clip.person],
        }


def explained_by_shape(weights: Weights, features: NDArray) -> Weights:
    """Explain the differences of log W between people by their shape, as far as possible.

    Least squares on their `features` (P, K, 3), in which soft nodes have more weight. Training
    fits the residuals of each person sooner than the slopes, but people who were not in training
    have no residuals. The sum of both stays the same for people in training.
    """
    deviations = (features @ weights.slopes + weights.residual).astype(np.float64)
    centred, differences = features - features.mean(0), deviations - deviations.mean(0)
    softness = np.exp(-weights.base["omega"].astype(np.float64))
    rows = (softness * centred).reshape(-1, features.shape[-1])
    ridge = 1e-2 * np.square(rows).sum() / rows.shape[1] * np.eye(rows.shape[1])
    right = rows.T @ (softness * differences).reshape(-1, 1)
    # One person alone, or equal ones, do not determine the slopes.
    slopes = np.linalg.solve(rows.T @ rows + ridge, right) if rows.any() else 0 * right
    shared = deviations.mean(0) - features.mean(0) @ slopes
    powers = weights.powers()
    base = {n: log + np.float32(powers.get(n, 0.0)) * shared for n, log in weights.base.items()}
    return replace(
        weights,
        base={name: log.astype(np.float32) for name, log in base.items()},
        slopes=slopes.astype(np.float32),
        residual=(differences - centred @ slopes).astype(np.float32),
    )


def _a_step_before(offsets_m: NDArray, frame: int) -> NDArray:
    """Offsets (K, 3) a step before a frame, on the parabola through it and the two before it."""
    now, before, earlier = offsets_m[frame], offsets_m[frame - 1], offsets_m[frame - 2]
    fraction = 1 / STEPS
    straight = now + fraction * (before - now)
    return straight - fraction * (1 - fraction) / 2 * (now - 2 * before + earlier)


def train_plus(
    config: TrainPlusConfig, simulate: Simulate, training: type[PlusTraining] = PlusTraining
) -> None:
    """Make the artifact `train_plus`, or continue an interrupted training.

    Nothing is done if the artifact is current. A study that trains in another way passes its own
    configuration and `training`.
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
    """Train with a checkpoint after every round, and write the artifact."""
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
        progress = {
            "history/loss": np.array(losses),
            "static/constant": static.constant_m,
            "static/by_pose": static.by_pose_m,
        }
        save_checkpoint(checkpoint, {**training.state(), **progress})
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
