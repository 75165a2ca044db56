"""DSNet one frame at a time, for characters that move while one watches; no framework."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.dsnet import TrainedDsnet, load_trained_dsnet
from bridge.paper import N_BETAS, THETA_SIZE
from bridge.runs import Run
from bridge.runtime.bounds import check_poses, check_shapes, numbers
from bridge.runtime.dsnet_step import DsnetModel


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
        self._model = DsnetModel(run)
        self.reset()

    def reset(self) -> None:
        """Forget the past; the next step may have another number of characters."""
        self._state = np.empty((0, 0), np.float32)

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
        past = self._state if len(self._state) else self._model.reset(betas, theta)
        self._state, latents = self._model.step(self._model.reshaped(past, betas), theta)
        return latents

    def _check(self, theta: tuple[int, ...], betas: tuple[int, ...]) -> None:
        if len(theta) != 2 or theta[1] != THETA_SIZE or betas != (theta[0], N_BETAS):
            raise DsnetError(
                f"theta {theta} and betas {betas}",
                f"theta (B, {THETA_SIZE}) and betas (B, {N_BETAS})",
                "Pass one row for each character, also for a single one.",
            )
        if len(self._state) not in (0, theta[0]):
            raise DsnetError(
                f"{theta[0]} characters after {len(self._state)}",
                "the same characters at every step",
                "Call reset() when characters come or go.",
            )
