"""DSNet: two dense layers, one LSTM, batch normalisation, one dense layer (Figure 5, Section 5)."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.paper import DSNET_WIDTHS, INPUT_SIZE
from tf_dsnet.framework import keras


def build_dsnet(
    *,
    masked: bool = False,
    lstm_layer: type[keras.layers.LSTM] = keras.layers.LSTM,
    input_size: int = INPUT_SIZE,
) -> keras.Model:
    """Build DSNet (B, T, 79) -> (B, T, 100): 65,140 parameters, 65,020 of them trainable.

    Parameters
    ----------
    masked : take a second input (B, T), True for real frames, and leave padded frames out of the
        statistics of the batch normalisation. The paper mentions no mask, so the default lets
        them in. The weights are the same in both forms, and so are predictions: the LSTM needs
        no mask, for padding stands at the end and time runs forwards.
    lstm_layer : Keras's LSTM, or one that computes the same (`tf_dsnet.lstm.BlockLSTM`).
    input_size : numbers that it is told of a motion at each frame, where they are not the paper's.
    """
    units = DSNET_WIDTHS
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


def named_weights(model: keras.Model) -> dict[str, NDArray]:
    """Copies of all weights, named `<layer>/<variable>`, such as `fc_enc_1/kernel`."""
    return {name: variable.numpy() for name, variable in named_variables(model).items()}


def assign_weights(model: keras.Model, weights: Mapping[str, NDArray]) -> None:
    """Set all weights from arrays named as by `named_weights`.

    Raises
    ------
    DsnetError
        If a name or a shape is not the network's.
    """
    variables = named_variables(model)
    wanted = {name: tuple(variable.shape) for name, variable in variables.items()}
    given = {name: array.shape for name, array in weights.items()}
    if odd := sorted(set(wanted.items()) ^ set(given.items())):
        first = next(iter(wanted))
        raise DsnetError(
            f"weights that differ from {model.name}'s in "
            f"{', '.join(sorted({name for name, _ in odd}))}",
            f"{len(wanted)} arrays such as {first} {wanted[first]}",
            "Pass weights written by `dsnet train`.",
        )
    for name, variable in variables.items():
        variable.assign(weights[name])


def parameter_counts(model: keras.Model) -> dict[str, int]:
    """Parameters of a built model: all, and those that training changes by gradients."""
    trainable = sum(int(variable.shape.num_elements()) for variable in model.trainable_variables)
    return {"dsnet": int(model.count_params()), "dsnet_trainable": trainable}


def named_variables(model: keras.Model) -> dict[str, keras.Variable]:
    """The model's own variables, named as by `named_weights`."""
    return {
        f"{layer.name}/{variable.name}": variable
        for layer in model.layers
        for variable in layer.weights
    }
