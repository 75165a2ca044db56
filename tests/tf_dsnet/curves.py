"""Losses as TensorBoard would read them."""

from __future__ import annotations

from pathlib import Path

from tf_dsnet.framework import tf


def read_curve(folder: Path) -> dict[int, float]:
    """Losses by epoch of the one file in a folder."""
    (file,) = folder.iterdir()
    records = tf.data.TFRecordDataset(str(file)).as_numpy_iterator()
    events = map(tf.compat.v1.Event.FromString, records)
    return {
        event.step: tf.make_ndarray(value.tensor).item()
        for event in events
        for value in event.summary.value
        if value.tag == "epoch_loss" and value.metadata.plugin_data.plugin_name == "scalars"
    }
