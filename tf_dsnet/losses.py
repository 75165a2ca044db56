"""The paper's loss: L2 distances in latent space, summed over time (Section 4.3)."""

from __future__ import annotations

from tf_dsnet.framework import tf


def sum_of_distances(
    target: tf.Tensor, predicted: tf.Tensor, real: tf.Tensor | None = None
) -> tf.Tensor:
    """Sum over t of ||predicted_t - target_t||_2 (not squared), then the mean over the batch.

    Parameters
    ----------
    target, predicted : (B, T, 100) latents.
    real : (B, T), True for frames that count; all of them, padding too, when None.

    Returns
    -------
    tf.Tensor
        A scalar in the latents' unit. Its gradient is 0 where a distance is 0.
    """
    squared = tf.reduce_sum(tf.square(predicted - target), axis=-1)  # (B, T)
    nonzero = squared > 0.0
    # The inner choice keeps the square root's infinite slope at 0 out of the gradient.
    distance = tf.where(nonzero, tf.sqrt(tf.where(nonzero, squared, 1.0)), 0.0)
    if real is not None:
        distance = tf.where(real, distance, 0.0)
    return tf.reduce_mean(tf.reduce_sum(distance, axis=-1))
