"""The chain of layers, its names and its gradients."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from bridge.exchange.weights import autoencoder_shapes
from dsnet.verify.reference import mesh_autoencoder

WIDTHS = (11, 7, 7, 4, 2)


def small(seed: int = 0) -> tuple[dict[str, np.ndarray], np.ndarray]:
    rng = np.random.default_rng(seed)
    shapes = autoencoder_shapes(WIDTHS)
    weights = {name: rng.normal(scale=0.4, size=shape) for name, shape in shapes.items()}
    return weights, rng.normal(size=(3, 11, 3))


def test_layers_come_in_the_order_of_figure_3():
    weights, values = small()
    outputs = mesh_autoencoder.forward(weights, values).outputs
    plain = [name for name in outputs if not name.endswith("_activation")]
    assert plain == [name.removesuffix(".weight") for name in weights if name.endswith("weight")]
    assert outputs["to_latent"].shape == (3, 100)
    assert outputs["from_latent"].shape == (3, 18)
    assert outputs["to_coordinates"].shape == (3, 11, 3)
    assert set(outputs) - set(plain) == {
        f"{name}_activation" for name in plain if name not in ("to_latent", "to_coordinates")
    }


def test_gradients_of_every_parameter():
    weights, values = small()
    target = 0.5 * values
    gradients = mesh_autoencoder.learn(weights, values, target).gradients
    assert set(gradients) == set(weights)
    rng = np.random.default_rng(1)
    for name, gradient in gradients.items():
        direction = rng.normal(size=gradient.shape)

        def loss(step: float, name: str = name, direction: np.ndarray = direction) -> float:
            moved = {**weights, name: weights[name] + step * direction}
            return mesh_autoencoder.learn(moved, values, target).loss

        found = (loss(1e-6) - loss(-1e-6)) / 2e-6
        assert_allclose((gradient * direction).sum(), found, rtol=1e-5, atol=1e-8, err_msg=name)
