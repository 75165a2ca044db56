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
        statistics of the batch normalisation. The paper mentions no mask, so the default lets
        them in. The weights are the same in both forms, and so are predictions: the LSTM needs
        no mask, for padding stands at the end and time runs forwards.
    lstm_layer : Keras's LSTM, or one that computes the same, as `BlockLSTM` does.
    input_size : numbers that it is told of a motion at each frame, where they are not the paper's.
    widths : units of layers by name; the paper's for those that are left out.
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


def sum_of_distances(target: Tensor, predicted: Tensor, real: Tensor | None = None) -> Tensor:
    """The paper's loss (Section 4.3): sum over t of ||predicted_t - target_t||_2, not squared, of
    latents (B, T, 100), then the mean over the batch.

    Only frames that are `real` (B, T) count; all of them, padding too, when None. The gradient is 0
    where a distance is 0.
    """
    squared = tf.reduce_sum(tf.square(predicted - target), axis=-1)  # (B, T)
    nonzero = squared > 0.0
    # The inner choice keeps the square root's infinite slope at 0 out of the gradient.
    distance = tf.where(nonzero, tf.sqrt(tf.where(nonzero, squared, 1.0)), 0.0)
    if real is not None:
        distance = tf.where(real, distance, 0.0)
    return tf.reduce_mean(tf.reduce_sum(distance, axis=-1))


def with_own_names(model: keras.Model) -> keras.Model:
    """The model, with names that Keras gave its layers counted within it.

    Keras counts in the process: what was built before would change the names of weights in files.
    """
    counts: Counter[str] = Counter()
    for layer in model.layers:
        kind = re.sub(r"_\d+$", "", layer.name)
        if kind.replace("_", "") == type(layer).__name__.lower():
            counts[kind] += 1
            layer.name = kind if counts[kind] == 1 else f"{kind}_{counts[kind]}"
    return model


def named_variables(model: keras.Model) -> dict[str, keras.Variable]:
    """The model's own variables, named `<layer>/<variable>`, such as `fc_enc_1/kernel`."""
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
    """Set a network's variables; refused if a name or a shape is not its own."""
    wanted = {name: tuple(variable.shape) for name, variable in variables.items()}
    remedy = "Pass weights written by `dsnet train` or `dsnet train-ae`, of the same architecture."
    check_shapes(weights, wanted, f"{network}'s", remedy)
    for name, variable in variables.items():
        variable.assign(weights[name])


def parameter_counts(model: keras.Model) -> dict[str, int]:
    """Parameters of a built model: all, and those that training changes by gradients."""
    trainable = sum(int(variable.shape.num_elements()) for variable in model.trainable_variables)
    return {"dsnet": int(model.count_params()), "dsnet_trainable": trainable}


class BlockLSTM(keras.layers.LSTM):
    """`keras.layers.LSTM`, by TensorFlow's operation of the same name where that can do it.

    Weights, options and results are Keras's. On a CPU Keras loops over time in the graph, and
    most of a frame's time goes by between operations, of which there are dozens; `BlockLSTM`
    is one, forwards and backwards. It knows no mask, no dropout and no other activations, and
    works in float32: everything else is left to Keras, and so are GPUs, where Keras has cuDNN.
    """

    def build(self, sequences_shape: Any, initial_state_shape: Any = None) -> None:
        super().build(sequences_shape, initial_state_shape)
        # XLA does not know the operation, and `compile` would choose XLA of its own accord.
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
        # Not `BlockLSTMV2`: its registered gradient is that of this one, whose gates are in
        # another order.
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
    """Keras's gates (input, forget, cell, output) as the operation wants them: cell second."""
    into, forget, cell, out = tf.split(columns, 4, axis=-1)
    return tf.concat([into, cell, forget, out], -1)
