"""Clips as Keras's `fit` takes them, in the order in which `dsnet train` does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.dsnet import Clips
from tf_dsnet.framework import DataAdapter, keras, tf


def batches_of_epoch(count: int, batch_size: int, seed: int, epoch: int) -> list[NDArray[np.int64]]:
    """Rows of each batch of an epoch, counted from 0: an order that seed and epoch decide."""
    order = np.random.default_rng([seed, epoch]).permutation(count)
    return np.split(order, range(batch_size, count, batch_size))


class ClipBatches(keras.utils.PyDataset):
    """Motions (B, T, 79) and latents (B, T, 100) of clips, for `keras.Model.fit`.

    Pass `shuffle=False`: every epoch has an order of its own. With the callback `in_order()` it is
    that of the epoch's number, also after `keras.callbacks.BackupAndRestore`: from the weights at
    the start, with optimizer and loss of `Trainer`, `fit` then gives its bits.
    """

    def __init__(self, clips: Clips, batch_size: int = 16, seed: int = 0) -> None:
        super().__init__()
        self._clips, self._batch_size, self._seed = clips, batch_size, seed
        self._rows: list[NDArray[np.int64]] = []
        self._begin(0)

    def __len__(self) -> int:
        return math.ceil(len(self._clips) / self._batch_size)

    def __getitem__(self, index: int) -> tuple[NDArray, NDArray]:
        rows = self._rows[index]
        return self._clips.inputs[rows], self._clips.latents[rows]

    def in_order(self) -> keras.callbacks.Callback:
        """A callback that draws the order of each epoch before its first batch."""
        return keras.callbacks.LambdaCallback(
            on_epoch_begin=lambda epoch, _logs: self._begin(epoch)
        )

    def on_epoch_end(self) -> None:
        """Draw another order; Keras may call this once before the first epoch."""
        self._begin(self._epoch + 1)

    def _begin(self, epoch: int) -> None:
        self._epoch = epoch
        self._rows = batches_of_epoch(len(self._clips), self._batch_size, self._seed, epoch)


class DrawnBatches(DataAdapter):
    """Rows of arrays, nested in any way, for `fit`: those that `rows` gives when an epoch begins.

    `fit` would make a pipeline of `tf.data` at every call, which takes a good part of the time of
    an epoch of so few clips; an adapter is taken as it is.
    """

    def __init__(self, arrays: Any, rows: Callable[[], list[NDArray[np.int64]]]) -> None:
        self._tensors = tf.nest.map_structure(tf.convert_to_tensor, arrays)
        self._rows, self._drawn = rows, rows()

    def get_tf_dataset(self) -> DrawnBatches:
        return self

    def __iter__(self) -> Iterator[Any]:
        for rows in map(tf.constant, self._drawn):
            yield tf.nest.map_structure(lambda tensor: tf.gather(tensor, rows), self._tensors)  # noqa: B023

    @property
    def num_batches(self) -> int:
        return len(self._drawn)

    def on_epoch_begin(self) -> None:
        self._drawn = self._rows()

    def on_epoch_end(self) -> None: ...
