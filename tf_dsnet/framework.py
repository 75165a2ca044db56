"""TensorFlow and Keras, loaded quietly: the only module that imports them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from bridge.installation import require_packages_of

require_packages_of("tf_dsnet")
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("TF_FORCE_GPU_ALLOW_GROWTH", "true")
# With one thread an operation `train` takes a quarter less time, as its operations are small, and
# results do not depend on the number of cores, among which sums would be split.
os.environ.setdefault("TF_NUM_INTRAOP_THREADS", "1")
# Set always: KERAS_BACKEND=torch in the environment would load PyTorch into this process.
os.environ["KERAS_BACKEND"] = "tensorflow"


@contextmanager
def quietly() -> Iterator[None]:
    """Keep what TensorFlow's C++ code logs from stderr; if it fails, the exception says why."""
    sys.stderr.flush()
    stderr = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)


with quietly():  # about oneDNN and CUDA, before it reads TF_CPP_MIN_LOG_LEVEL
    import keras
    import tensorflow as tf
    from keras.src.trainers.data_adapters.data_adapter import DataAdapter

Tensor: TypeAlias = Any
"""A tensor or an array: TensorFlow's annotations accept neither arrays nor `...` as an index."""

__all__ = ["DataAdapter", "Tensor", "be_reproducible", "keras", "quietly", "tf"]


def be_reproducible(seed: int) -> None:
    """Make TensorFlow compute the same bits in every run, for the rest of the process.

    Seeds the initial weights, and makes operations add in a fixed order, also on a GPU.
    """
    keras.utils.set_random_seed(seed)
    tf.config.experimental.enable_op_determinism()
    # An AddN adds its terms in the order in which threads finish. So a + b + c, and gradients of a
    # value that is used three times, must not become an AddN; two terms have no order.
    tf.config.optimizer.set_experimental_options({"arithmetic_optimization": False})
    tf.AggregationMethod.DEFAULT = tf.AggregationMethod.EXPERIMENTAL_TREE
