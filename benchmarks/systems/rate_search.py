"""The care that every compared network gets: its own learning rate, and its best epoch.

A tenth of the epochs goes to each of three learning rates, all from the same initial weights. What
is left goes to the one with the least validation loss, from where it stands; of all epochs that
were validated the best one's weights are kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.weights import load_checkpoint, save_checkpoint
from tf_dsnet.model import named_weights, parameter_counts
from tf_dsnet.trainer import Trainer

RATES = (1e-3, 3e-3, 1e-2)
"""Of Adam; `dsnet_standardised` has the first."""
SEARCH_SHARE = 0.1
"""Of all epochs, for each of them."""
_DIVERGED = float(np.finfo(np.float32).max)
"""Stands for a loss that is no number."""
_REMEDY = "Train with fewer --epochs, or leave this predictor out."


@dataclass
class _Found:
    """A trainer's state and the validation loss that it has."""

    loss: float
    rate: float
    state: dict[str, NDArray]


class RateSearch:
    """One network's training; see `PredictorTraining`.

    Parameters
    ----------
    name : the predictor's, for errors.
    trainer : the network, fresh.
    epochs : the whole budget.
    validation_loss : of the network as it stands.
    finished : what the predictor needs to be loaded, of the trained weights.
    checkpoint : file of an interrupted training.
    """

    def __init__(
        self,
        name: str,
        trainer: Trainer,
        epochs: int,
        validation_loss: Callable[[], float],
        finished: Callable[[Mapping[str, NDArray]], dict[str, NDArray]],
        checkpoint: Path,
    ) -> None:
        self.name, self.trainer = name, trainer
        self.losses: list[float] = []
        """Of every epoch so far, of all rates one after another."""
        self.validation_losses: list[float] = []
        """Of every epoch that was validated."""
        self._leg_epochs = max(1, int(SEARCH_SHARE * epochs))
        self._validation_loss, self._finished = validation_loss, finished
        self._checkpoint = checkpoint
        self._fresh = trainer.state()
        self._best_leg = self._kept = _Found(math.inf, RATES[0], self._fresh)
        if (state := load_checkpoint(checkpoint)) is not None:
            self._resume(state)

    @property
    def lr(self) -> float:
        """The learning rate that was chosen, or leads so far."""
        return self._best_leg.rate

    def epoch(self, number: int, *, validate: bool) -> None:
        """Train for epoch `number`, unless the checkpoint was behind it already.

        Raises
        ------
        DsnetError
            If no learning rate gives a finite loss.
        """
        if number < len(self.losses):
            return
        leg, place = divmod(number, self._leg_epochs)
        searching = leg < len(RATES)
        if searching and place == 0:
            self._set_out(self._fresh, RATES[leg])
        elif number == len(RATES) * self._leg_epochs:
            self._set_out(self._best_leg.state, self._best_leg.rate)
        self.losses.append(_finite_or_diverged(self.trainer.epoch(number)))
        leg_ends = searching and place == self._leg_epochs - 1
        if validate or leg_ends:
            self._judge(leg_ends, validate)

    def save(self) -> None:
        """Write the checkpoint."""
        found = {"best_leg": self._best_leg, "kept": self._kept}
        arrays = {f"now/{name}": array for name, array in self.trainer.state().items()}
        arrays["search/rate"] = np.array([self.trainer.lr])
        for key, one in found.items():
            arrays |= {f"{key}/{name}": array for name, array in one.state.items()}
            arrays[f"search/{key}"] = np.array([min(one.loss, _DIVERGED), one.rate])
        history = {"loss": self.losses, "validation_loss": self.validation_losses}
        arrays |= {f"history/{name}": np.array(values) for name, values in history.items()}
        save_checkpoint(self._checkpoint, arrays)

    def arrays(self) -> dict[str, NDArray]:
        """What has been learned, of the best validated epoch.

        Raises
        ------
        DsnetError
            If no epoch gave a finite validation loss.
        """
        if self._kept.loss >= _DIVERGED:
            raise DsnetError(
                f"{self.name} without a finite validation loss at any of {RATES}", "one", _REMEDY
            )
        now = self.trainer.state()
        self.trainer.restore(self._kept.state)
        weights = named_weights(self.trainer.model)
        self.trainer.restore(now)
        return self._finished(weights)

    def parameters(self) -> dict[str, int]:
        """Parameters of the network."""
        return parameter_counts(self.trainer.model)

    def _set_out(self, state: Mapping[str, NDArray], rate: float) -> None:
        self.trainer.restore(state)
        self.trainer.optimizer.learning_rate = self.trainer.lr = rate

    def _judge(self, leg_ends: bool, validate: bool) -> None:
        loss = _finite_or_diverged(self._validation_loss())
        if validate:
            self.validation_losses.append(loss)
        if loss < min(self._kept.loss, _DIVERGED):
            self._kept = _Found(loss, self.trainer.lr, self.trainer.state())
        if leg_ends and loss < min(self._best_leg.loss, _DIVERGED):
            self._best_leg = _Found(loss, self.trainer.lr, self.trainer.state())

    def _resume(self, arrays: dict[str, NDArray]) -> None:
        parts: dict[str, dict[str, NDArray]] = {}
        for name, array in arrays.items():
            part, _, own = name.partition("/")
            parts.setdefault(part, {})[own] = array
        self.losses, self.validation_losses = (
            parts["history"][name].tolist() for name in ("loss", "validation_loss")
        )
        found = parts["search"]
        self._best_leg, self._kept = (
            _Found(float(found[key][0]), float(found[key][1]), parts[key])
            for key in ("best_leg", "kept")
        )
        self._set_out(parts["now"], float(found["rate"][0]))


def _finite_or_diverged(loss: float) -> float:
    return loss if math.isfinite(loss) else _DIVERGED
