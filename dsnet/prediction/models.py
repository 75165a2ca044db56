"""One predictor, one step. Whole motions, loops, streams, the viewer and exports repeat it.

    state = model.reset(betas, theta0)           # characters who have stood in theta0 for ever
    state, codes = model.step(state, theta)      # one frame, 1/60 s, of all of them
    offsets_m = model.offsets_m(betas, codes, theta)

The first step is given theta0 again. Codes of a step are those of `look_ahead` frames ago, of the
first frame until then; they may be mixed linearly. A motion ends by standing still in its last
pose, without a jolt: `model.stopped(state)` and that pose `look_ahead` times more. The step itself
is the deployable graph without the skin, run by ONNX Runtime.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Protocol

import numpy as np
import onnx
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange.dsnet import TrainedDsnet
from bridge.exchange.weights import load_autoencoder
from bridge.paper import FPS, N_BETAS
from bridge.runs import Artifact
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx.clip_graph import over_frames
from dsnet.onnx.network_graphs import (
    decoder_graph,
    dsnet_body_graph,
    dsnet_layout,
    dsnet_step_graph,
)
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.onnx.plus_graph import plus_begin_graph, plus_graph, plus_layout, plus_step_graph
from dsnet.onnx.precision import Precision
from dsnet.prediction.loops import Loop
from dsnet.prediction.runtimes import LatentsOf

_MOTIONS_AT_ONCE = 32
"""Simulated side by side."""
FRAMES_AT_ONCE = 64
"""Frames in a piece of offsets: what is held in memory at a time."""
SETTLED_M = 1e-4
"""Two rounds of a loop whose offsets differ nowhere by more are the same."""
LONGEST_S, FEWEST_ROUNDS = 30.0, 6
"""Tissue that has not settled after so long, and so many rounds, never does."""
State = NDArray[np.float32]
"""(B, S): a row is the whole state of a character. Rows may be taken, stacked and reordered from
frame to frame; what is made of one is independent of the others, and none is ever changed."""
Codes = NDArray[np.float32]
"""(B, ...)."""
Piece = NDArray[np.float32]
"""(T', V, 3) offsets of some frames."""
_PLACE = slice(-3, None)
"""Of theta: where the root is. Of `dsnet_plus`'s state: where it was at first, as float32 knows
places near the origin best."""
_STATE_BEGINS = (
    "that of begin.onnx for a character that begins, or that a cut puts elsewhere; then \
next_state of the frame before"
)
"""For the metadata of `dsnet_plus`'s step without control flow."""
_BETAS, _MEMORY = slice(0, N_BETAS), slice(N_BETAS, None)
"""Of DSNet's state."""


class Model(Protocol):
    """A trained predictor on a body."""

    look_ahead: int
    """Frames after which a frame's codes come."""
    codes_are_latents: bool

    def reset(self, betas: NDArray, theta0: NDArray) -> State:
        """Characters (B, 10) who are at rest in the poses theta0 (B, 69)."""
        ...

    def step(self, state: State, theta: NDArray) -> tuple[State, Codes]:
        """The state one frame later, in the poses theta (B, 69), and codes."""
        ...

    def stopped(self, state: State) -> State:
        """The same characters, who will not have moved when they take their newest pose again."""
        ...

    def offsets_m(self, betas: NDArray, codes: Codes, theta: NDArray) -> Piece:
        """(N, V, 3) skin offsets in the rest pose, metres, of codes (N, ...) in the poses theta
        (N, 69), of characters betas (N, 10) or frames of one (10,)."""
        ...

    def graph(self, metadata: Mapping[str, str], precision: Precision) -> onnx.ModelProto:
        """The step and the posed skin as one graph, for tools that have ONNX Runtime alone."""
        ...

    def clip_graph(self, metadata: Mapping[str, str]) -> onnx.ModelProto:
        """The same of all frames of clips at once, with the offsets."""
        ...

    def plain_graphs(self, metadata: Mapping[str, str]) -> dict[str, onnx.ModelProto]:
        """The same without control flow: `step`, and `begin` if states do not begin as zeros."""
        ...


class PlusModel:
    """`dsnet_plus`, a `Model` whose codes are offsets (3, K) of the nodes, metres.

    A frame's load is smoothed over poses that lie `look_ahead` frames ahead at most, and its
    acceleration needs the pose after: it moves the next frame's offsets.

    Parameters
    ----------
    body : the body model that it was trained with.
    threads : its operations are small: for one character threads would wait for one another.
    """

    codes_are_latents = False

    def __init__(self, model: TrainedPlus, body: BodyModelData, threads: int = 1) -> None:
        self.look_ahead = model.look_ahead
        self.trained, self._body, self._layout = model, body, plus_layout(model, skin=False)
        self._run = GraphSession(plus_step_graph(model, body), threads)

    def __reduce__(self) -> tuple[type, tuple[TrainedPlus, BodyModelData]]:
        return type(self), (self.trained, self._body)

    def reset(self, betas: NDArray, theta0: NDArray) -> State:
        """The graph settles them in their first step: some 10 ms each."""
        state = np.zeros((len(betas), self._layout.size + 3), np.float32)
        state[:, self._layout.columns("betas")] = betas
        state[:, _PLACE] = theta0[:, _PLACE]
        return state

    def step(self, state: State, theta: NDArray) -> tuple[State, Codes]:
        about_start = np.array(theta, np.float64)
        about_start[:, _PLACE] -= state[:, _PLACE]
        outputs = self._run(
            theta=about_start.astype(np.float32),
            betas=state[:, self._layout.columns("betas")],
            state=state[:, : self._layout.size],
        )
        return np.concatenate([outputs["next_state"], state[:, _PLACE]], 1), outputs["codes"]

    def stopped(self, state: State) -> State:
        """Nodes that have not moved have no acceleration where they stay."""
        still = state.copy()
        still[:, self._layout.columns("moves")] = 0
        return still

    def offsets_m(self, betas: NDArray, codes: Codes, theta: NDArray) -> Piece:
        offsets_m = self.trained.nodes.spread(codes.transpose(0, 2, 1))
        static_m = self.trained.static_m(self._body, betas, theta)
        return offsets_m if static_m is None else offsets_m + static_m

    def graph(self, metadata: Mapping[str, str], precision: Precision) -> onnx.ModelProto:
        return plus_graph(self.trained, self._body, metadata, precision)

    def clip_graph(self, metadata: Mapping[str, str]) -> onnx.ModelProto:
        return over_frames(plus_graph(self.trained, self._body, metadata, with_offsets=True))

    def plain_graphs(self, metadata: Mapping[str, str]) -> dict[str, onnx.ModelProto]:
        about = {**metadata, "state": _STATE_BEGINS}
        step = plus_graph(self.trained, self._body, about, control_flow=False, with_offsets=True)
        return {"step": step, "begin": plus_begin_graph(self.trained, self._body)}


class DsnetModel:
    """The paper's DSNet, a `Model` whose codes are latents (100,).

    Parameters
    ----------
    codec : the finished `train-ae` whose decoder makes offsets of latents, and
    body : the body model that they are of; None where only codes are needed.
    latents_of : what predicts whole motions in place of the step, if anything does.
    """

    look_ahead = 0
    codes_are_latents = True

    def __init__(
        self,
        network: TrainedDsnet,
        codec: Artifact | None = None,
        body: BodyModelData | None = None,
        latents_of: LatentsOf | None = None,
    ) -> None:
        self._network, self._codec, self._body = network, codec, body
        self.latents_of = latents_of
        self._memory = dsnet_layout(network).size
        self._run = GraphSession(dsnet_step_graph(network), threads=1)
        self._decoder = codec and GraphSession(decoder_graph(*load_autoencoder(codec)))

    def reset(self, betas: NDArray, theta0: NDArray) -> State:
        state = np.zeros((len(betas), N_BETAS + self._memory), np.float32)
        return self.reshaped(state, betas)

    def step(self, state: State, theta: NDArray) -> tuple[State, Codes]:
        betas = state[:, _BETAS]
        inputs = np.concatenate([betas, np.asarray(theta, np.float32)], axis=1)
        outputs = self._run(motion=inputs, state=state[:, _MEMORY])
        return np.concatenate([betas, outputs["next_state"]], axis=1), outputs["codes"]

    def reshaped(self, state: State, betas: NDArray) -> State:
        """The same past, of bodies betas (B, 10) from here on."""
        state = state.copy()
        state[:, _BETAS] = betas
        return state

    def stopped(self, state: State) -> State:
        """Nothing is owed."""
        return state

    def offsets_m(self, betas: NDArray, codes: Codes, theta: NDArray) -> Piece:
        assert self._decoder is not None
        return self._decoder(latents=codes)["offsets"]

    def graph(self, metadata: Mapping[str, str], precision: Precision) -> onnx.ModelProto:
        return self._body_graph(metadata, precision)

    def clip_graph(self, metadata: Mapping[str, str]) -> onnx.ModelProto:
        return over_frames(self._body_graph(metadata, with_offsets=True))

    def plain_graphs(self, metadata: Mapping[str, str]) -> dict[str, onnx.ModelProto]:
        return {"step": self._body_graph(metadata, control_flow=False, with_offsets=True)}

    def _body_graph(
        self,
        metadata: Mapping[str, str],
        precision: Precision = "float32",
        control_flow: bool = True,
        with_offsets: bool = False,
    ) -> onnx.ModelProto:
        assert self._codec is not None
        assert self._body is not None
        codec = load_autoencoder(self._codec)
        return dsnet_body_graph(
            self._network, *codec, self._body, metadata, precision, control_flow, with_offsets
        )


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a predictor says of one motion of T frames, of a body that begins from rest, settled in
    its first pose."""

    offsets_m: Iterator[Piece]
    """Skin offsets in the rest pose, metres: pieces that follow one another."""
    latents: NDArray[np.float32] | None = None
    """(T, 100) codes that the offsets are decoded from, if they are."""


def predict_whole(model: Model, theta: NDArray, betas: NDArray) -> Prediction:
    """A motion theta (T, 69) at 60 frames a second without a cut, of a body betas (10,)."""
    if isinstance(model, DsnetModel) and model.latents_of is not None:
        codes = latents = model.latents_of(theta, betas)
        return Prediction(decoded(model, codes, theta, betas), latents)
    codes = codes_of(model, theta, betas)
    latents = np.stack([*codes]) if model.codes_are_latents else None
    return Prediction(decoded(model, codes if latents is None else latents, theta, betas), latents)


def decoded(
    model: Model, codes: Iterable[NDArray], theta: NDArray, betas: NDArray
) -> Iterator[Piece]:
    """The offsets that codes of the frames of a motion theta (T, 69) stand for."""
    codes = iter(codes)
    for start in range(0, len(theta), FRAMES_AT_ONCE):
        piece = theta[start : start + FRAMES_AT_ONCE]
        yield model.offsets_m(betas, np.stack([*islice(codes, len(piece))]), piece)


def codes_of(model: Model, theta: NDArray, betas: NDArray) -> Iterator[NDArray[np.float32]]:
    """The code of each frame of a motion theta (T, 69) of a body (10,)."""
    return (codes[0] for _, codes in codes_of_several(model, [theta], betas[None]))


def codes_of_several(
    model: Model, motions: Sequence[NDArray], betas: NDArray
) -> Iterator[tuple[NDArray[np.intp], Codes]]:
    """For one frame after another, which of some motions (T, 69) of bodies betas (B, 10) have it,
    and their codes."""
    lengths = np.array([len(theta) for theta in motions])
    here = np.arange(len(motions))
    state = model.reset(betas, np.stack([theta[0] for theta in motions]))
    for frame in range(int(lengths.max()) + model.look_ahead):
        left = lengths[here] - frame
        if left.min() <= -model.look_ahead:
            goes_on = left > -model.look_ahead
            here, state, left = here[goes_on], state[goes_on], left[goes_on]
        if not left.all():
            state = np.where(left[:, None] == 0, model.stopped(state), state)
        poses = [motions[row][min(frame, len(motions[row]) - 1)] for row in here.tolist()]
        state, codes = model.step(state, np.stack(poses))
        if frame >= model.look_ahead:
            yield here, codes


def simulate_nodes(
    trained: TrainedPlus, body: BodyModelData, motions: Sequence[NDArray], betas: NDArray
) -> list[NDArray[np.float32]]:
    """Offsets (T, K, 3) of the nodes, without the static part, of motions theta (T, 69) of people
    betas (B, 10)."""
    model = PlusModel(trained, body, threads=0)
    offsets = [np.empty((len(theta), len(trained.nodes), 3), np.float32) for theta in motions]
    for start in range(0, len(offsets), _MOTIONS_AT_ONCE):
        some = slice(start, start + _MOTIONS_AT_ONCE)
        for frame, (rows, codes) in enumerate(codes_of_several(model, motions[some], betas[some])):
            for row, code in zip(rows, codes, strict=True):
                offsets[start + row][frame] = code.T
    return offsets


def finished(model: Model, state: State, theta: NDArray) -> list[Codes]:
    """The codes still to come if motions end in their newest poses theta (B, 69)."""
    state, last = model.stopped(state), []
    for _ in range(model.look_ahead):
        state, codes = model.step(state, theta)
        last.append(codes)
    return last


def predict_loop(
    predict: Callable[[NDArray, NDArray], Prediction], loop: Loop, betas: NDArray
) -> Prediction:
    """A motion that repeats: round after round until nothing of the start is left of the tissue.

    Memory does not grow with the number of rounds: those before the last are let go as they come.
    """
    frames = len(loop.theta)
    most = max(int(LONGEST_S * FPS / frames), FEWEST_ROUNDS)
    every = -(-frames // FRAMES_AT_ONCE)
    # One round more than is ever given: its last frames are smoothed over those that follow.
    prediction = predict(loop.repeated(most + 1), betas)
    each, before, differ_m = chain.from_iterable(prediction.offsets_m), None, np.inf
    for done in range(1, most):
        cycle = enumerate(islice(each, frames))
        sample = np.stack([offsets for at, offsets in cycle if (frames - 1 - at) % every == 0])
        if before is not None:
            differ_m = float(np.linalg.norm(sample - before, axis=-1).max())
        if differ_m < SETTLED_M:
            first = done * frames
            latents = (
                None if prediction.latents is None else prediction.latents[first : first + frames]
            )
            return Prediction(_in_pieces(islice(each, frames)), latents)
        before = sample
    raise DsnetError(
        f"--loop with offsets that still differ by {1e3 * differ_m:.1f} mm after {most} rounds",
        f"rounds that agree within {1e3 * SETTLED_M:g} mm",
        "Name another --predictor: one that does not depend on where the body is.",
    )


def _in_pieces(frames: Iterator[Piece]) -> Iterator[Piece]:
    while piece := [*islice(frames, FRAMES_AT_ONCE)]:
        yield np.stack(piece)
