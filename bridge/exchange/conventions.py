"""Constants on which the frameworks' defaults differ: what training means here, in either of them.

DSNet is trained by Keras, so its batch normalisation and its Adam are Keras's; the mesh
autoencoder is trained by PyTorch, so its Adam is PyTorch's. A twin in the other framework takes
these in place of that framework's defaults.
"""

from __future__ import annotations

from dataclasses import dataclass

BATCH_NORM_EPSILON = 1e-3
"""Added to the variance under the root; PyTorch's default is 1e-5."""
BATCH_NORM_MOMENTUM = 0.99
"""moving = momentum * moving + (1 - momentum) * batch; PyTorch calls 1 - momentum momentum."""
MASKED_COUNT_EPSILON = 1e-7
"""Keras divides masked sums by count + this, in the mean and in the variance."""


@dataclass(frozen=True)
class AdamRule:
    """Adam as one framework computes it; t counts steps from 1.

    epsilon_hat:     w -= lr sqrt(1 - b2^t) / (1 - b1^t) * m / (sqrt(v) + epsilon)
    not epsilon_hat: w -= lr / (1 - b1^t) * m / (sqrt(v / (1 - b2^t)) + epsilon)
    """

    learning_rate: float = 1e-4
    """The paper's, for both networks (Section 5)."""
    beta_1: float = 0.9
    """Decay of the first moment."""
    beta_2: float = 0.999
    """Decay of the second moment."""
    epsilon: float = 1e-7
    """Keeps the division finite."""
    epsilon_hat: bool = True
    """Whether epsilon stands beside the second moment before its bias correction."""


KERAS_ADAM = AdamRule()
"""`keras.optimizers.Adam`, with which DSNet is trained."""
TORCH_ADAM = AdamRule(epsilon=1e-8, epsilon_hat=False)
"""`torch.optim.Adam`, with which the autoencoder is trained."""
