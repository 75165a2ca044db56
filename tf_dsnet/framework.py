"""TensorFlow and Keras, loaded quietly: the only module that imports them."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def _stderr_held_back() -> Iterator[None]:
    """Keep the process's stderr to itself, and let it out only if the block fails, not if a user
    interrupts it.

    TensorFlow's C++ logs about oneDNN and CUDA while it loads, before it reads
    `TF_CPP_MIN_LOG_LEVEL`, so no setting silences them.
    """
    sys.stderr.flush()
    stderr = os.dup(2)
    with tempfile.TemporaryFile() as held, os.fdopen(stderr, "wb") as original:
        os.dup2(held.fileno(), 2)
        try:
            yield
        except Exception:
            held.seek(0)
            shutil.copyfileobj(held, original)
            raise
        finally:
            original.flush()
            os.dup2(stderr, 2)


with _stderr_held_back():
    import keras
    import tensorflow as tf

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
