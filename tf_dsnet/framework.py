"""TensorFlow and Keras, loaded quietly: the only module that imports them."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("TF_FORCE_GPU_ALLOW_GROWTH", "true")
# A user's KERAS_BACKEND=torch would load PyTorch into this process.
os.environ["KERAS_BACKEND"] = "tensorflow"


@contextmanager
def _stderr_held_back() -> Iterator[None]:
    """Keep the process's stderr to itself, and let it out only if the block fails.

    TensorFlow's C++ logs about oneDNN and CUDA while it loads, before it reads
    `TF_CPP_MIN_LOG_LEVEL`, so no setting silences them.
    """
    sys.stderr.flush()
    stderr = os.dup(2)
    with tempfile.TemporaryFile() as held, os.fdopen(stderr, "wb") as original:
        os.dup2(held.fileno(), 2)
        try:
            yield
        except BaseException:
            held.seek(0)
            shutil.copyfileobj(held, original)
            raise
        finally:
            original.flush()
            os.dup2(stderr, 2)


with _stderr_held_back():
    import keras
    import tensorflow as tf

__all__ = ["keras", "tf"]
