"""TensorFlow and Keras, loaded quietly: the only module that imports them."""

from __future__ import annotations

import os
import sys
from typing import Any, TypeAlias

from bridge.installation import require_packages_of

require_packages_of("tf_dsnet")
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("TF_FORCE_GPU_ALLOW_GROWTH", "true")
# Threads of one small operation wait for one another: with one, `train` takes a quarter less time,
# and no bit depends on how many cores there are, for they would split its sums.
os.environ.setdefault("TF_NUM_INTRAOP_THREADS", "1")
# A user's KERAS_BACKEND=torch would load PyTorch into this process.
os.environ["KERAS_BACKEND"] = "tensorflow"


# TensorFlow's C++ logs about oneDNN and CUDA while it loads, before it reads TF_CPP_MIN_LOG_LEVEL;
# a failure is an exception, which says why.
sys.stderr.flush()
_STDERR = os.dup(2)
with open(os.devnull, "wb") as _nowhere:
    os.dup2(_nowhere.fileno(), 2)
try:
    import keras
    import tensorflow as tf
finally:
    os.dup2(_STDERR, 2)
    os.close(_STDERR)

Tensor: TypeAlias = Any
"""A tensor or an array: TensorFlow's own annotations refuse arrays, and `...` in an index."""

__all__ = ["Tensor", "be_reproducible", "keras", "tf"]


def be_reproducible(seed: int) -> None:
    """The one place that says what TensorFlow needs so that two runs give the same bits.

    For the rest of the process: a seed for initial weights, and operations that add in a fixed
    order, also on a GPU.
    """
    keras.utils.set_random_seed(seed)
    tf.config.experimental.enable_op_determinism()
    # An AddN begins with whichever of its terms another thread is done with. Neither a + b + c nor
    # the gradient of what is used three times may become one: of two terms any order will do.
    tf.config.optimizer.set_experimental_options({"arithmetic_optimization": False})
    tf.AggregationMethod.DEFAULT = tf.AggregationMethod.EXPERIMENTAL_TREE
