"""Training of DSNet epoch by epoch; after an interruption it continues bit-identically."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.exchange.dsnet import Clips, Scaling, TrainedDsnet
from bridge.exchange.layers import layers_as_json
from bridge.exchange.weights import load_checkpoint, refuse_nonfinite, save_checkpoint
from tf_dsnet.clip_batches import batches_of_epoch
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
    """DSNet, or the network that `build` gives, and its Adam optimizer.

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
        input_size = clips.inputs.shape[-1]
        self.model, self._loss_function = with_own_names(build(input_size=input_size)), loss_of
        _check_output(self.model, clips.latents.shape[-1])
        self.optimizer = keras.optimizers.Adam(lr, name="adam")
        self.optimizer.build(self.model.trainable_variables)
        # Unknown sizes, so that the last, smaller batch does not build a second graph.
        signature = {
            "motion": tf.TensorSpec((None, None, input_size), keras.config.floatx()),
            "latents": tf.TensorSpec((None, None, clips.latents.shape[-1]), keras.config.floatx()),
            "real": tf.TensorSpec((None, None), tf.bool),
        }
        self._step = tf.function(self._train_on, input_signature=[signature])
        self._evaluate = tf.function(lambda b: self._loss_of(b), input_signature=[signature])

    def trace(self) -> None:
        """Build both graphs now, so that threads which train side by side only run them."""
        self._step.get_concrete_function()
        self._evaluate.get_concrete_function()

    def epoch(self, number: int) -> float:
        """Train on every clip once, in an order drawn for this epoch; gives the mean loss."""
        batches = batches_of_epoch(len(self._clips), self._batch_size, self._seed, number)
        losses = [self._step(_batch(self._clips, rows)) for rows in batches]
        return float(np.average([loss.numpy() for loss in losses], weights=[*map(len, batches)]))

    def loss(self, clips: Clips) -> float:
        """Mean loss of a clip with the batch normalisation's running statistics."""
        return float(self._evaluate(_batch(clips)).numpy())

    def gradients(self) -> tuple[float, dict[str, NDArray]]:
        """Loss of all clips in one batch, and its gradients by name of the trainable weight.

        This updates the running statistics, as a training step does.
        """
        loss, gradients = self._loss_and_gradients(_batch(self._clips))
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

    def _train_on(self, batch: dict[str, tf.Tensor]) -> tf.Tensor:
        loss, gradients = self._loss_and_gradients(batch)
        self.optimizer.apply(gradients, self.model.trainable_variables)
        return loss

    def _loss_and_gradients(self, batch: dict[str, tf.Tensor]) -> tuple[tf.Tensor, list[Tensor]]:
        with tf.GradientTape() as tape:
            loss = self._loss_of(batch, training=True)
        return loss, tape.gradient(loss, self.model.trainable_variables)

    def _loss_of(self, batch: dict[str, tf.Tensor], training: bool = False) -> tf.Tensor:
        motion, real = batch["motion"], batch["real"]
        takes_mask = self._masked and len(getattr(self.model, "inputs", (motion, real))) > 1
        predicted = self.model([motion, real] if takes_mask else motion, training=training)
        return self._loss_function(batch["latents"], predicted, real if self._masked else None)


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


def _batch(clips: Clips, rows: NDArray | slice = slice(None)) -> dict[str, tf.Tensor]:
    """Motions, latents and masks of real frames of the clips in these rows."""
    arrays = {"motion": clips.inputs, "latents": clips.latents, "real": clips.real}
    return {name: tf.constant(array[rows]) for name, array in arrays.items()}


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
