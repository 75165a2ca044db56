"""Figure 3's autoencoder in Keras, the twin of `torch_align_ae/autoencoder/mesh_autoencoder.py`.

It is trained in PyTorch. This one is for users of Keras alone, who can encode and decode with it,
and for `dsnet verify`, which compares the two. Layers have PyTorch's names, as `encoder.conv_1`.
"""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import NDArray

from bridge.exchange.weights import (
    TORCH_ADAM,
    mesh_autoencoder_from_keras,
    mesh_autoencoder_to_keras,
)
from bridge.paper import FEATURES, INFERRED_WIDTHS, LATENT_SIZE, NEGATIVE_SLOPE
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.model import assign_variables


@keras.saving.register_keras_serializable("dsnet")
class LeakyReLU(keras.layers.LeakyReLU):
    """Keras's layer without its fault that the slope is rounded to float32 in any precision."""

    def call(self, inputs: Tensor) -> Tensor:
        """Scale numbers up to 0; the derivative at 0 is that below, as in PyTorch."""
        return tf.where(inputs > 0, inputs, self.negative_slope * inputs)


class KerasMeshAutoencoder:
    """The paper's mesh autoencoder (Section 4.1, Figure 3); works on normalised offsets.

    `encoder`, `decoder`, and `model`, which is both in a row, are Keras models; save `model` as
    `.keras`. `assign_weights` sets weights from PyTorch; new ones are initialised by Keras.
    `widths` are the number of vertices of the mesh and after each convolution.
    """

    def __init__(self, widths: tuple[int, ...] = INFERRED_WIDTHS) -> None:
        self.widths = tuple(widths)
        self.encoder, self.decoder = self._encoder(), self._decoder()
        values = keras.Input((self.widths[0], FEATURES[0]), name="values")
        restored = self.decoder(self.encoder(values))
        self.model = keras.Model(values, restored, name="mesh_autoencoder")

    def _encoder(self) -> keras.Model:
        values = keras.Input((self.widths[0], FEATURES[0]), name="values")
        features = self._linear(values, "encoder.linear_1", FEATURES[1])
        features = self._linear(features, "encoder.linear_2", FEATURES[2])
        coarse = self._convolutions(features, "encoder", self.widths[1:])  # (B, 30, 9)
        flat = keras.layers.Flatten(name="to_row")(coarse)
        latents = keras.layers.Dense(LATENT_SIZE, name="to_latent")(flat)
        return keras.Model(values, latents, name="encoder")

    def _decoder(self) -> keras.Model:
        latents = keras.Input((LATENT_SIZE,), name="latents")
        coarsest = self.widths[-1]
        flat = self._linear(latents, "from_latent", coarsest * FEATURES[2])
        coarse = keras.layers.Reshape((coarsest, FEATURES[2]), name="from_row")(flat)
        features = self._convolutions(coarse, "decoder", self.widths[-2::-1])  # (B, V, 9)
        features = self._linear(features, "decoder.linear_1", FEATURES[1])
        values = keras.layers.Dense(FEATURES[0], name="to_coordinates")(features)
        return keras.Model(latents, values, name="decoder")

    def _convolutions(self, features: Tensor, side: str, widths: tuple[int, ...]) -> Tensor:
        """Convolutions over vertices, (B, in, 9) to (B, out, 9).

        With kernel size 1 and vertices as channels each is a matrix product, which TensorFlow
        computes twice as fast as a `Conv1D`.
        """
        features = keras.layers.Permute((2, 1), name=f"{side}.vertices_last")(features)
        for number, width in enumerate(widths, start=1):
            features = self._linear(features, f"{side}.conv_{number}", width)
        return keras.layers.Permute((2, 1), name=f"{side}.vertices_first")(features)

    def _linear(self, features: Tensor, name: str, width: int) -> Tensor:
        """A linear layer on the last axis, and its nonlinearity as a separate layer."""
        features = keras.layers.Dense(width, name=name)(features)
        return LeakyReLU(NEGATIVE_SLOPE, name=f"{name}_activation")(features)


def named_variables(model: keras.Model) -> dict[str, keras.Variable]:
    """Variables by Keras's names, in the order of the layers, which is PyTorch's."""
    layers = [layer for part in ("encoder", "decoder") for layer in model.get_layer(part).layers]
    return {f"{layer.name}/{v.name}": v for layer in layers for v in layer.weights}


def named_weights(model: keras.Model) -> dict[str, NDArray]:
    """Copies of all weights of `KerasMeshAutoencoder.model` in PyTorch's names and layout."""
    return mesh_autoencoder_from_keras(
        {name: variable.numpy() for name, variable in named_variables(model).items()}
    )


def assign_weights(model: keras.Model, weights: Mapping[str, NDArray]) -> None:
    """Set all weights of `KerasMeshAutoencoder.model` from arrays named as by PyTorch."""
    arrays = mesh_autoencoder_to_keras(weights)
    assign_variables(named_variables(model), arrays, "the autoencoder")


class TorchAdam(keras.optimizers.Adam):
    """Adam as in PyTorch, which trains the autoencoder: epsilon is added after bias correction.

    For eager steps only, as Keras's epsilon must change with each step for that.
    """

    def __init__(self) -> None:
        rule = TORCH_ADAM
        super().__init__(rule.learning_rate, rule.beta_1, rule.beta_2, name="adam")

    def update_step(
        self, gradient: Tensor, variable: keras.Variable, learning_rate: Tensor
    ) -> None:
        step = int(self.iterations) + 1
        self.epsilon = TORCH_ADAM.epsilon * (1.0 - self.beta_2**step) ** 0.5
        super().update_step(gradient, variable, learning_rate)
