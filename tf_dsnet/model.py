"""DSNet: two dense layers, one LSTM, batch normalisation, one dense layer (Figure 5, Section 5),
and the paper's loss."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from bridge.exchange.weights import check_shapes
from bridge.paper import DSNET_WIDTHS, INPUT_SIZE
from tf_dsnet.framework import Tensor, keras, tf


def build_dsnet(
    *,
    masked: bool = False,
    lstm_layer: type[keras.layers.LSTM] = keras.layers.LSTM,
    input_size: int = INPUT_SIZE,
    widths: Mapping[str, int] = DSNET_WIDTHS,
) -> keras.Model:
    """Build DSNet (B, T, 79) -> (B, T, 100): 65,140 parameters, 65,020 of them trainable.

    Parameters
    ----------
    masked : take a second input (B, T), True for real frames, and leave padded frames out of the
        statistics of the batch normalisation. The paper mentions no mask, so by default they
        are included. Weights have the same shapes either way. The LSTM needs no mask, as padding
        comes after the real frames.
    lstm_layer : Keras's LSTM, or a layer that computes the same, such as `BlockLSTM`.
    input_size : numbers of a motion at each frame.
    widths : units of layers by name; those that are missing are the paper's.
    """
    units = {**DSNET_WIDTHS, **widths}
    fc_enc_1 = keras.layers.Dense(units["fc_enc_1"], name="fc_enc_1")
    fc_enc_2 = keras.layers.Dense(units["fc_enc_2"], activation="tanh", name="fc_enc_2")
    lstm = lstm_layer(units["lstm"], return_sequences=True, name="lstm")
    batch_norm = keras.layers.BatchNormalization(name="batch_norm")
    fc_enc_3 = keras.layers.Dense(units["fc_enc_3"], name="fc_enc_3")

    motion = keras.Input((None, input_size), name="motion")
    real = keras.Input((None,), dtype="bool", name="real_frames") if masked else None
    memory = lstm(fc_enc_2(fc_enc_1(motion)))  # (B, T, 60)
    latents = fc_enc_3(batch_norm(memory, mask=real))

    return keras.Model([motion, real] if masked else motion, latents, name="dsnet")


@keras.saving.register_keras_serializable("dsnet")
class SumOfDistances(keras.losses.Loss):
    """The paper's loss (Section 4.3) for `compile`: `sum_of_distances` of whole batches."""

    def call(self, y_true: Tensor, y_pred: Tensor) -> Tensor:
        """Of each clip (B,), of latents (B, T, 100); Keras takes their mean."""
        return tf.reduce_sum(_distances(y_true, y_pred), axis=-1)


def sum_of_distances(target: Tensor, predicted: Tensor, real: Tensor | None = None) -> Tensor:
    """The paper's loss (Section 4.3), of latents (B, T, 100).

    It is the sum over t of ||predicted_t - target_t||_2, not squared, then the mean over the batch.
    Only frames that are `real` (B, T) count; when None, all of them do, padding too.
    """
    distance = _distances(target, predicted)
    if real is not None:
        distance = tf.where(real, distance, 0.0)
    return tf.reduce_mean(tf.reduce_sum(distance, axis=-1))


def _distances(target: Tensor, predicted: Tensor) -> Tensor:
    """||predicted_t - target_t||_2 (B, T); the gradient is 0 where it is 0."""
    squared = tf.reduce_sum(tf.square(predicted - target), axis=-1)  # (B, T)
    nonzero = squared > 0.0
    # The inner `where` keeps the infinite slope of the square root at 0 out of the gradient.
    return tf.where(nonzero, tf.sqrt(tf.where(nonzero, squared, 1.0)), 0.0)


def with_own_names(model: keras.Model) -> keras.Model:
    """Number the layers that have Keras's automatic names within the model; gives the model.

    Keras numbers them within the process, so models that were built before would change the names
    of weights in files.
    """
    counts: Counter[str] = Counter()
    for layer in model.layers:
        kind = re.sub(r"_\d+$", "", layer.name)
        if kind.replace("_", "") == type(layer).__name__.lower():
            counts[kind] += 1
            layer.name = kind if counts[kind] == 1 else f"{kind}_{counts[kind]}"
    return model


def named_variables(model: keras.Model) -> dict[str, keras.Variable]:
    """The model's variables, named `<layer>/<variable>`, such as `fc_enc_1/kernel`."""
    return {
        f"{layer.name}/{variable.name}": variable
        for layer in model.layers
        for variable in layer.weights
    }


def named_weights(model: keras.Model) -> dict[str, NDArray]:
    """Copies of all weights, named as by `named_variables`."""
    return {name: variable.numpy() for name, variable in named_variables(model).items()}


def assign_weights(model: keras.Model, weights: Mapping[str, NDArray]) -> None:
    """Set all weights from arrays named as by `named_weights`."""
    assign_variables(named_variables(model), weights, model.name)


def assign_variables(
    variables: Mapping[str, keras.Variable], weights: Mapping[str, NDArray], network: str
) -> None:
    """Set a network's variables; `DsnetError` if names or shapes are not those of the network."""
    shapes = {name: tuple(variable.shape) for name, variable in variables.items()}
    remedy = "Pass weights written by `dsnet train` or `dsnet train-ae`, of the same architecture."
    check_shapes(weights, shapes, f"{network}'s", remedy)
    for name, variable in variables.items():
        variable.assign(weights[name])


def parameter_counts(model: keras.Model) -> dict[str, int]:
    """Parameters of a built model: all, and the trainable ones."""
    trainable = sum(int(variable.shape.num_elements()) for variable in model.trainable_variables)
    return {"dsnet": int(model.count_params()), "dsnet_trainable": trainable}


@keras.saving.register_keras_serializable("dsnet")
class BlockLSTM(keras.layers.LSTM):
    """`keras.layers.LSTM` computed by TensorFlow's operation `BlockLSTM` where that is possible.

    Weights, options and results are Keras's. On a CPU Keras loops over time with dozens of small
    operations a frame, whose overhead takes most of the time; `BlockLSTM` is one operation for all
    frames, and so is its gradient. It supports no mask, no dropout and no other activations, and
    float32 alone: all other cases are left to Keras, and so are GPUs, where Keras uses cuDNN.
    """

    def build(self, sequences_shape: Any, initial_state_shape: Any = None) -> None:
        super().build(sequences_shape, initial_state_shape)
        # XLA lacks the operation, and `compile` would choose XLA by default.
        self.supports_jit = False

    def inner_loop(
        self, sequences: Tensor, initial_state: Tensor, mask: Tensor, training: bool = False
    ) -> tuple[Tensor, Tensor, list[Tensor]]:
        """Last output (B, H), outputs (B, T, H) and states [(B, H), (B, H)] of (B, T, C)."""
        is_one_operation = (
            mask is None
            and tf.as_dtype(sequences.dtype) == tf.float32
            and self.activation is keras.activations.tanh
            and self.recurrent_activation is keras.activations.sigmoid
            and self.use_bias
            and not (self.go_backwards or self.dropout or self.recurrent_dropout)
            and not tf.config.list_physical_devices("GPU")
        )
        if not is_one_operation:
            return super().inner_loop(sequences, initial_state, mask, training)
        hidden, memory = initial_state
        kernel = tf.concat([self.cell.kernel, self.cell.recurrent_kernel], 0)
        time_first = tf.transpose(sequences, (1, 0, 2))
        no_peephole = tf.zeros(self.units)
        # Not `BlockLSTMV2`: TensorFlow registers this operation's gradient for it, although its
        # gates are in another order.
        _, memories, *_, outputs = tf.raw_ops.BlockLSTM(
            seq_len_max=tf.shape(time_first, out_type=tf.int64)[0],
            x=time_first,
            cs_prev=memory,
            h_prev=hidden,
            w=_gates_in_order(kernel),
            b=_gates_in_order(self.cell.bias),
            wci=no_peephole,
            wcf=no_peephole,
            wco=no_peephole,
            forget_bias=0.0,
            cell_clip=0.0,
        )
        return outputs[-1], tf.transpose(outputs, (1, 0, 2)), [outputs[-1], memories[-1]]


def _gates_in_order(columns: Tensor) -> Tensor:
    """Keras's gates (input, forget, cell, output) in the operation's order: cell second."""
    into, forget, cell, out = tf.split(columns, 4, axis=-1)
    return tf.concat([into, cell, forget, out], -1)


LSTM_LAYERS: dict[str, type[keras.layers.LSTM]] = {"block": BlockLSTM, "stock": keras.layers.LSTM}
"""By their names among the options of `dsnet train`."""
