"""Losses as TensorBoard reads them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tf_dsnet.framework import tf


class LossCurves:
    """Losses of networks, written to `folder`/NAME/train and `folder`/NAME/validation.

    Folders and tags are those of `keras.callbacks.TensorBoard`, which writes only where package
    `tensorboard` is installed. Who goes on with a training writes into the same folders.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._writers: dict[Path, Any] = {}
        metadata: Any = tf.compat.v1.SummaryMetadata()
        metadata.plugin_data.plugin_name = "scalars"
        self._metadata = metadata

    def add(self, split: str, losses: Mapping[str, float], epoch: int) -> None:
        """Write losses by network of an epoch, counted from 0; `split` is train or validation."""
        for name, loss in losses.items():
            folder = self._folder / name / split
            if folder not in self._writers:
                self._writers[folder] = tf.summary.create_file_writer(str(folder))
            with self._writers[folder].as_default():
                value = tf.constant(loss, tf.float32)
                tf.summary.write("epoch_loss", value, step=epoch, metadata=self._metadata)
