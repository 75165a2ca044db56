"""Keras's LSTM with its loop over time in one operation: faster on a CPU."""

from __future__ import annotations

from typing import Any

from tf_dsnet.framework import Tensor, keras, tf


class BlockLSTM(keras.layers.LSTM):
    """`keras.layers.LSTM`, by TensorFlow's operation of the same name where that can do it.

    Weights, options and results are Keras's. On a CPU Keras loops over time in the graph, and
    most of a frame's time goes by between operations, of which there are dozens; `BlockLSTM`
    is one, forwards and backwards. It knows no mask, no dropout and no other activations, and
    works in float32: everything else is left to Keras, and so are GPUs, where Keras has cuDNN.
    """

    def build(self, sequences_shape: Any, initial_state_shape: Any = None) -> None:
        """Create the weights of Keras's cell."""
        super().build(sequences_shape, initial_state_shape)
        # XLA does not know the operation, and `compile` would choose XLA of its own accord.
        self.supports_jit = False

    def inner_loop(
        self, sequences: Tensor, initial_state: Tensor, mask: Tensor, training: bool = False
    ) -> tuple[Tensor, Tensor, list[Tensor]]:
        """Last output (B, H), outputs (B, T, H) and states [(B, H), (B, H)] of (B, T, C)."""
        if mask is not None or not self._is_one_operation(sequences.dtype):
            return super().inner_loop(sequences, initial_state, mask, training)
        return self._one_operation(tf.transpose(sequences, (1, 0, 2)), *initial_state)

    def _is_one_operation(self, dtype: str) -> bool:
        return (
            tf.as_dtype(dtype) == tf.float32
            and self.activation is keras.activations.tanh
            and self.recurrent_activation is keras.activations.sigmoid
            and self.use_bias
            and not (self.go_backwards or self.dropout or self.recurrent_dropout)
            and not tf.config.list_physical_devices("GPU")
        )

    def _one_operation(
        self, sequences: Tensor, hidden: Tensor, memory: Tensor
    ) -> tuple[Tensor, Tensor, list[Tensor]]:
        kernel = tf.concat([self.cell.kernel, self.cell.recurrent_kernel], 0)
        no_peephole = tf.zeros(self.units)
        # Not `BlockLSTMV2`: its registered gradient is that of this one, whose gates are in
        # another order.
        _, memories, *_, outputs = tf.raw_ops.BlockLSTM(
            seq_len_max=tf.shape(sequences, out_type=tf.int64)[0],
            x=sequences,
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
