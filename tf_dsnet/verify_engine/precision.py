"""Keras in float64, which takes more than one setting."""

from __future__ import annotations

import numpy as np

from bridge.verify.protocol import DTypeName
from tf_dsnet.framework import keras


def compute_in(dtype: DTypeName) -> None:
    """Build layers and optimizers in this precision from now on."""
    keras.config.set_floatx(dtype)
    # The first layer of a process fixes the policy, and a later floatx does not change it.
    keras.config.set_dtype_policy(dtype)


def exact(adam: keras.optimizers.Adam) -> None:
    """Let Adam correct its moments with decays in float64, if that is what it computes in.

    Keras turns its decays, Python's numbers, into float32 before it widens them: 1 - 0.999 is then
    off by 1.3e-5, and so is every step. In float32 that is the rule itself.
    """
    if keras.config.floatx() == "float64":
        adam.beta_1, adam.beta_2 = np.float64(adam.beta_1), np.float64(adam.beta_2)
