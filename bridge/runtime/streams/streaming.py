"""DSNet one frame at a time, for characters that move while one watches; NumPy alone.

At this size a step costs less than TensorFlow's call of a function, so the
step is three matrix products in NumPy. What is affine in a trained network is
folded together once: the scaling of the inputs into the linear `fc_enc_1` and
that into `fc_enc_2`, the batch normalisation into `fc_enc_3` and the scaling
of the latents. All four gates come from one tanh, as
sigmoid(z) = (1 + tanh(z / 2)) / 2.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.layouts import BATCH_NORM_EPSILON
from bridge.exchange.trained_dsnet import TrainedDsnet, load_trained_dsnet
from bridge.paper import N_BETAS, THETA_SIZE
from bridge.runs import Run
from bridge.runtime.bounds import check_poses, check_shapes, numbers


@dataclass(frozen=True, eq=False)
class _Affine:
    kernel: NDArray
    bias: NDArray

    def then(self, other: _Affine) -> _Affine:
        return _Affine(self.kernel @ other.kernel, self.bias @ other.kernel + other.bias)

    def as_float32(self) -> _Affine:
        return _Affine(np.ascontiguousarray(self.kernel, np.float32), self.bias.astype(np.float32))

    def __call__(self, x: NDArray) -> NDArray:
        y = x @ self.kernel
        y += self.bias
        return y


class StreamingPredictor:
    """Predicts latents step by step and remembers each character's past (Section 4.2).

    Parameters
    ----------
    run : name of a run whose stage `train` is finished, or a loaded `TrainedDsnet`.
    predictor : which of the run's networks; the run's own choice when None.

    Raises
    ------
    DsnetError
        If there is no such run, or it lacks that network.
    """

    def __init__(
        self, run: str | os.PathLike[str] | TrainedDsnet, predictor: str | None = None
    ) -> None:
        if not isinstance(run, TrainedDsnet):
            run = load_trained_dsnet(Run(os.fspath(run)).artifact("train"), predictor)
        self._network = SteppedDsnet(run)

    def reset(self) -> None:
        """Forget the past; the next step may have another number of characters."""
        self._network.reset()

    def step(self, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """Advance every character by one frame (1/60 s).

        Parameters
        ----------
        theta : (B, 69) poses of B characters, in the same order at every step.
        betas : (B, 10) their shapes.

        Returns
        -------
        ndarray
            (B, 100) latents, as the autoencoder decodes them.

        Raises
        ------
        DsnetError
            If the shapes are others, B has changed since the last `reset`, a number is not finite,
            or a pose or shape is no person's. Then nothing has moved: go on with the next frame.
        """
        theta, betas = numbers("theta", theta), numbers("betas", betas)
        self._check(theta.shape, betas.shape)
        check_poses("theta", theta)
        check_shapes("betas", betas)
        return self._network.step(np.concatenate((betas, theta), axis=1, dtype=np.float32))

    def _check(self, theta: tuple[int, ...], betas: tuple[int, ...]) -> None:
        if len(theta) != 2 or theta[1] != THETA_SIZE or betas != (theta[0], N_BETAS):
            raise DsnetError(
                f"theta {theta} and betas {betas}",
                f"theta (B, {THETA_SIZE}) and betas (B, {N_BETAS})",
                "Pass one row for each character, also for a single one.",
            )
        if self._network.characters not in (0, theta[0]):
            raise DsnetError(
                f"{theta[0]} characters after {self._network.characters}",
                "the same characters at every step",
                "Call reset() when characters come or go.",
            )


class SteppedDsnet:
    """A trained DSNet frame by frame; it remembers each character's past."""

    def __init__(self, trained: TrainedDsnet) -> None:
        self._encode, self._gates, self._decode = _fold(trained)
        self._units = len(self._decode.kernel)
        self.reset()

    @property
    def characters(self) -> int:
        """How many it remembers."""
        return len(self._memory)

    def remembered(self) -> NDArray[np.float32]:
        """(2, B, 60) the LSTM's cells and hidden state after the last step."""
        return np.stack([self._memory, self._features_and_hidden[:, -self._units :]])

    def recall(self, remembered: NDArray[np.float32] | None) -> None:
        """Go on from what was `remembered`, of the same or other characters; None: from nothing."""
        self.reset()
        if remembered is not None:
            self._start(remembered.shape[1])
            self._memory[:], self._features_and_hidden[:, -self._units :] = remembered

    def reset(self) -> None:
        """Forget the past."""
        self._memory = self._features_and_hidden = np.empty((0, 0), np.float32)

    def step(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Latents (B, 100) of the next frame from inputs (B, 79) in a motion's own units."""
        if not len(self._memory):
            self._start(len(inputs))
        both, units = self._features_and_hidden, self._units
        np.tanh(self._encode(inputs), out=both[:, :-units])
        gates = self._gates(both)
        np.tanh(gates, out=gates)
        candidate = gates[:, 2 * units : 3 * units].copy()
        gates *= np.float32(0.5)
        gates += np.float32(0.5)  # now sigmoids, but for the candidate's columns
        self._memory *= gates[:, units : 2 * units]
        self._memory += gates[:, :units] * candidate
        hidden = np.tanh(self._memory)
        hidden *= gates[:, 3 * units :]
        both[:, -units:] = hidden
        return self._decode(hidden)

    def _start(self, characters: int) -> None:
        self._memory = np.zeros((characters, self._units), np.float32)
        # The arguments of the gates stand side by side, so that nothing is copied at a step.
        self._features_and_hidden = np.zeros((characters, len(self._gates.kernel)), np.float32)


def _fold(trained: TrainedDsnet) -> tuple[_Affine, _Affine, _Affine]:
    """Inputs to tanh's argument; features and hidden state to gates; hidden state to latents."""
    w = {name: array.astype(np.float64) for name, array in trained.weights.items()}
    scale = trained.scaling

    def dense(layer: str) -> _Affine:
        return _Affine(w[f"{layer}/kernel"], w[f"{layer}/bias"])

    scaled = _Affine(np.diag(1 / scale.input_std), -scale.input_mean / scale.input_std)
    gain = w["batch_norm/gamma"] / np.sqrt(w["batch_norm/moving_variance"] + BATCH_NORM_EPSILON)
    normalised = _Affine(np.diag(gain), w["batch_norm/beta"] - gain * w["batch_norm/moving_mean"])
    restored = _Affine(np.diag(scale.latent_std), scale.latent_mean)

    encode = scaled.then(dense("fc_enc_1")).then(dense("fc_enc_2"))
    decode = normalised.then(dense("fc_enc_3")).then(restored)
    recurrent = w["lstm/recurrent_kernel"]  # (60, 240), gates in the order i, f, c, o
    halved = np.repeat([0.5, 0.5, 1.0, 0.5], len(recurrent))
    gates = _Affine(np.vstack([w["lstm/kernel"], recurrent]) * halved, w["lstm/bias"] * halved)
    return encode.as_float32(), gates.as_float32(), decode.as_float32()
