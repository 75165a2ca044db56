"""Training of DSNet epoch by epoch; after an interruption it continues bit-identically."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.dsnet import Clips, Scaling, TrainedDsnet
from bridge.exchange.layers import layers_as_json
from bridge.exchange.weights import load_checkpoint, refuse_nonfinite, save_checkpoint
from tf_dsnet.clip_batches import DrawnBatches, batches_of_epoch
from tf_dsnet.framework import Tensor, be_reproducible, keras, tf
from tf_dsnet.layers import NoChain, layers_of
from tf_dsnet.model import (
    BlockLSTM,
    assign_variables,
    build_dsnet,
    named_variables,
    named_weights,
    parameter_counts,
    sum_of_distances,
    with_own_names,
)

Build = Callable[..., keras.Model]
"""Builds a network of `input_size` numbers at each frame."""
LossOf = Callable[[Tensor, Tensor, "Tensor | None"], Tensor]
_REMEDY = "Train with a lower learning rate: dsnet train --help names the options."


class Trainer:
    """DSNet, or the network that `build` gives, trained by Keras's own `compile` and `fit`.

    An epoch depends on `state`, the seed, which also draws the initial weights, and the epoch's
    number, so a restored trainer gives the bits of an uninterrupted one. `loss_of` takes targets,
    predictions (B, T, D) and, if `masked`, which frames are real: padded ones are then left out of
    the loss and of the batch normalisation's statistics.
    """

    def __init__(
        self,
        clips: Clips,
        *,
        lr: float,
        batch_size: int = 16,
        masked: bool = False,
        seed: int = 0,
        build: Build | None = None,
        loss_of: LossOf = sum_of_distances,
    ) -> None:
        be_reproducible(seed)
        # By default with an LSTM that is fast on a CPU.
        build = build or partial(build_dsnet, masked=masked, lstm_layer=BlockLSTM)
        self._clips, self._batch_size, self._seed = clips, batch_size, seed
        self._masked, self.lr = masked, lr
        self.model: Any = with_own_names(build(input_size=clips.inputs.shape[-1]))
        _check_output(self.model, clips.latents.shape[-1])
        self.optimizer = keras.optimizers.Adam(lr, name="adam")
        self.optimizer.build(self.model.trainable_variables)
        self.model.compile(self.optimizer, _LossOfFrames(loss_of), jit_compile=False)
        self._epoch = 0
        examples = self._examples(clips)
        self._data = DrawnBatches(examples, self._rows)
        # Keras's own steps, for batches of any size: a graph of one size rounds otherwise, and
        # `fit` would make several.
        spec = tf.nest.map_structure(
            lambda array: tf.TensorSpec((None, None, *array.shape[2:]), array.dtype), examples
        )
        self._steps = [
            tf.function(step, input_signature=[spec], autograph=False)
            for step in (self.model.train_step, self.model.test_step)
        ]
        self.model.train_function, self.model.test_function = map(_on_next, self._steps)

    def trace(self) -> None:
        """Build both graphs now, so that threads which train side by side only run them."""
        for step in self._steps:
            step.get_concrete_function()

    def epoch(self, number: int) -> float:
        """Train on every clip once, in an order drawn for this epoch; gives the mean loss."""
        self._epoch = number
        history = self.model.fit(
            self._data, initial_epoch=number, epochs=number + 1, shuffle=False, verbose=0
        )
        return history.history["loss"][-1]

    def loss(self, clips: Clips) -> float:
        """Mean loss of a clip with the batch normalisation's running statistics."""
        self.model.reset_metrics()  # older Keras goes on with the mean of the epoch before
        return float(self.model.test_on_batch(*self._examples(clips)))

    def gradients(self) -> tuple[float, dict[str, NDArray]]:
        """Loss of all clips in one batch, and its gradients by name of the trainable weight.

        This updates the running statistics, as a training step does.
        """
        inputs, latents, *real = self._examples(self._clips)
        with tf.GradientTape() as tape:
            predicted = self.model(inputs, training=True)
            loss = self.model.compute_loss(inputs, latents, predicted, *real)
        gradients = tape.gradient(loss, self.model.trainable_variables)
        trainable = {id(variable) for variable in self.model.trainable_variables}
        names = [n for n, v in named_variables(self.model).items() if id(v) in trainable]
        return float(loss), {n: g.numpy() for n, g in zip(names, gradients, strict=True)}

    def state(self) -> dict[str, NDArray]:
        """Copies of weights, running statistics and the optimizer's moments."""
        return {name: variable.numpy() for name, variable in self._variables().items()}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Go back to what `state` returned, in this process or in an earlier one."""
        assign_variables(self._variables(), state, self.model.name)

    def _variables(self) -> dict[str, keras.Variable]:
        weights = named_variables(self.model)
        # Dropout has a random state, which changes with every step and is not among the weights.
        dropout_options = ("rate", "dropout", "recurrent_dropout")
        seeds = {
            f"{layer.name}/seed_{number}": variable
            for layer in self.model.layers
            if any(getattr(layer, name, 0) for name in dropout_options)
            for number, variable in enumerate(layer.variables[len(layer.weights) :])
        }
        # By place: Keras numbers layers without names anew in every process.
        moments = {f"adam/{n}": variable for n, variable in enumerate(self.optimizer.variables)}
        return {**weights, **seeds, **moments}

    def _rows(self) -> list[NDArray[np.int64]]:
        return batches_of_epoch(len(self._clips), self._batch_size, self._seed, self._epoch)

    def _examples(self, clips: Clips) -> tuple[Any, ...]:
        """Inputs of the network, latents and, if masked, real frames as sample weights."""
        motion, real = clips.inputs, clips.real
        if not self._masked:
            return motion, clips.latents
        takes_mask = len(getattr(self.model, "inputs", (motion, real))) > 1
        return (motion, real) if takes_mask else motion, clips.latents, real


def _on_next(step: Callable[[Any], Any]) -> Callable[[Iterator[Any]], Any]:
    """A step as Keras calls it: of batches, whose sample weights may be None."""
    return lambda batches: step(tuple(part for part in next(batches) if part is not None))


class _LossOfFrames(keras.losses.Loss):
    """A loss for `compile`, whose sample weights (B, T) say which frames are real."""

    def __init__(self, loss_of: LossOf) -> None:
        super().__init__(name="loss_of_frames")
        self._loss_of = loss_of

    def __call__(self, y_true: Tensor, y_pred: Tensor, sample_weight: Tensor = None) -> Tensor:
        return self._loss_of(y_true, y_pred, sample_weight)


def _check_output(model: keras.Model, latent_size: int) -> None:
    """Refuse a network with outputs of another shape, which the loss might silently broadcast."""
    # A subclassed model has no output shape before it is called.
    shape = getattr(model, "output_shape", (None, None, latent_size))
    if tuple(shape) != (None, None, latent_size):
        raise DsnetError(
            f"network {model.name!r} with outputs of shape {shape}",
            f"(None, None, {latent_size}): {latent_size} latents at every frame",
            "End with a layer of as many units; recurrent layers need return_sequences=True.",
        )


class DsnetTraining:
    """A `PredictorTraining` by one trainer; continues from its checkpoint if there is one.

    `scaling` is that of the trainer's clips; `validation` is for validation losses alone.
    """

    def __init__(
        self, name: str, trainer: Trainer, scaling: Scaling, validation: Clips, checkpoint: Path
    ) -> None:
        self.name, self.trainer = name, trainer
        self.losses: list[float] = []
        self.validation_losses: list[float] = []
        self._scaling, self._validation, self._checkpoint = scaling, validation, checkpoint
        if (state := load_checkpoint(checkpoint)) is not None:
            self.losses, self.validation_losses = (
                state.pop(f"history/{name}").tolist() for name in ("loss", "validation_loss")
            )
            trainer.restore(state)

    def epoch(self, number: int, *, validate: bool) -> None:
        """Train epoch `number`, unless the checkpoint already contains it."""
        if number < len(self.losses):
            return
        self.losses.append(self._finite(self.trainer.epoch(number), "loss", number))
        if validate:
            loss = self._finite(self.trainer.loss(self._validation), "validation loss", number)
            self.validation_losses.append(loss)

    def save(self) -> None:
        state = self.trainer.state()
        state["history/loss"] = np.array(self.losses)
        state["history/validation_loss"] = np.array(self.validation_losses)
        save_checkpoint(self._checkpoint, state)

    @property
    def lr(self) -> float:
        return self.trainer.lr

    def arrays(self) -> dict[str, NDArray]:
        """Trained weights and scaling; `DsnetError` if a weight is not finite."""
        weights = named_weights(self.trainer.model)
        refuse_nonfinite(weights, self.name, _REMEDY)
        return TrainedDsnet(self.name, weights, self._scaling).arrays()

    def described(self) -> dict[str, Any]:
        """The network's entry in a manifest: its `layers`, or in `no_chain` why it is no chain."""
        try:
            return {"layers": layers_as_json(layers_of(self.trainer.model))}
        except NoChain as reason:
            return {"no_chain": str(reason)}

    def parameters(self) -> dict[str, int]:
        return parameter_counts(self.trainer.model)

    def _finite(self, loss: float, what: str, number: int) -> float:
        if not math.isfinite(loss):
            received = f"{self.name} with a {what} of {loss} in epoch {number + 1}"
            raise DsnetError(received, "a number", _REMEDY)
        return loss
