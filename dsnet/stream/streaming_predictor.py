"""DSNet's latents step by step, of one character or many."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.dsnet import TrainedDsnet, load_trained_dsnet
from bridge.motion.motion import LARGEST_BETA
from bridge.paper import N_BETAS, THETA_SIZE
from bridge.runs import Run
from dsnet.prediction.models import DsnetModel
from dsnet.stream.stream_checks import check_poses, finite_numbers


class StreamingPredictor:
    """DSNet's latents step by step; it keeps the LSTM state of each character (Section 4.2).

    Parameters
    ----------
    run : name of a run whose stage `train` is finished, or a loaded `TrainedDsnet`.
    predictor : which of the run's networks; the run's default when None.
    """

    def __init__(
        self, run: str | os.PathLike[str] | TrainedDsnet, predictor: str | None = None
    ) -> None:
        if isinstance(run, (str, os.PathLike)):
            run = load_trained_dsnet(Run(os.fspath(run)).artifact("train"), predictor)
        self._model = DsnetModel(run)
        self.reset()

    def reset(self) -> None:
        """Reset all states; the next step may have another number of characters."""
        self._state = np.empty((0, 0), np.float32)

    def step(self, theta: NDArray, betas: NDArray) -> NDArray[np.float32]:
        """Latents (B, 100), as the autoencoder decodes them, of the next frame (1/60 s).

        `theta` (B, 69) are poses of B characters, in the same order at every step, and `betas`
        (B, 10) their shapes. Raises DsnetError if the arrays have other shapes, B has changed since
        the last `reset`, a number is not finite, or a pose or shape is impossible. States are then
        unchanged: go on with the next frame.
        """
        theta, betas = finite_numbers("theta", theta), finite_numbers("betas", betas)
        if theta.ndim != 2 or theta.shape[1] != THETA_SIZE or betas.shape != (len(theta), N_BETAS):
            raise DsnetError(
                f"theta {theta.shape} and betas {betas.shape}",
                f"theta (B, {THETA_SIZE}) and betas (B, {N_BETAS})",
                "Pass one row for each character, also for a single one.",
            )
        if len(self._state) not in (0, len(theta)):
            raise DsnetError(
                f"{len(theta)} characters after {len(self._state)}",
                "the same characters at every step",
                "Call reset() when characters come or go.",
            )
        check_poses("theta", theta)
        if (largest := np.abs(betas).max(initial=0.0)) > LARGEST_BETA:
            raise DsnetError(
                f"betas with a coefficient of {largest:.3g}",
                f"at most {LARGEST_BETA:g}",
                "Pass betas within a few standard deviations of 0; nothing has moved.",
            )
        past = self._state if len(self._state) else self._model.reset(betas, theta)
        self._state, latents = self._model.step(self._model.reshaped(past, betas), theta)
        return latents
