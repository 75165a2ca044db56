"""Training of what is fitted in one go: the first epoch does it and the others keep it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.weights import load_checkpoint, refuse_nonfinite, save_checkpoint

_HISTORY = "history/"
_REMEDY = "Leave this predictor out: dsnet train --help names the others."


@dataclass(frozen=True, eq=False)
class FitOutcome:
    """What a fit found."""

    arrays: dict[str, NDArray]
    """All that the predictor needs to be loaded."""
    loss: float
    """Over the training clips."""
    validation_loss: float
    """Over the validation clips."""


class FittedOnce:
    """A fit as a training; see `PredictorTraining`.

    Parameters
    ----------
    name : the predictor's, for errors.
    fit : makes it, the same at every call.
    size : how many numbers it learns.
    checkpoint : file of an interrupted training.
    """

    def __init__(
        self, name: str, fit: Callable[[], FitOutcome], size: int, checkpoint: Path
    ) -> None:
        self._name, self._fit, self._size, self._checkpoint = name, fit, size, checkpoint
        self._found: FitOutcome | None = None
        self.losses: list[float] = []
        """The fit's own, for every epoch."""
        self.validation_losses: list[float] = []
        """The same for every epoch that was validated."""
        if (state := load_checkpoint(checkpoint)) is not None:
            self._resume(state)

    @property
    def lr(self) -> float:
        """None."""
        return 0.0

    def epoch(self, number: int, *, validate: bool) -> None:
        """Fit, unless that is done."""
        if number < len(self.losses):
            return
        if self._found is None:
            self._found = self._fit()
        self.losses.append(self._found.loss)
        if validate:
            self.validation_losses.append(self._found.validation_loss)

    def save(self) -> None:
        """Write the checkpoint."""
        found = self._fitted()
        history = {"loss": self.losses, "validation_loss": self.validation_losses}
        history["of_fit"] = [found.loss, found.validation_loss]
        named = {_HISTORY + name: np.array(values) for name, values in history.items()}
        save_checkpoint(self._checkpoint, {**found.arrays, **named})

    def arrays(self) -> dict[str, NDArray]:
        """What has been fitted.

        Raises
        ------
        DsnetError
            If nothing has been, or a number is not finite.
        """
        arrays = self._fitted().arrays
        refuse_nonfinite(arrays, self._name, _REMEDY)
        return arrays

    def parameters(self) -> dict[str, int]:
        """Numbers that the fit learns."""
        return {self._name: self._size}

    def _fitted(self) -> FitOutcome:
        if self._found is None:
            raise DsnetError(f"{self._name} before its first epoch", "a fit", "Train an epoch.")
        return self._found

    def _resume(self, arrays: dict[str, NDArray]) -> None:
        self.losses, self.validation_losses, of_fit = (
            arrays.pop(_HISTORY + name).tolist() for name in ("loss", "validation_loss", "of_fit")
        )
        self._found = FitOutcome(arrays, *of_fit)
