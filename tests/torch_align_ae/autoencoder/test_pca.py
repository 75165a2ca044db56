"""The streamed PCA against a plain singular value decomposition."""

from __future__ import annotations

import numpy as np

from torch_align_ae.autoencoder.pca import PcaCodec, reconstruction_r2


def _offsets(rng: np.random.Generator) -> np.ndarray:
    spectrum = 1e-2 * 0.8 ** np.arange(60)
    left, right = rng.standard_normal((400, 60)), rng.standard_normal((60, 240))
    return ((left * spectrum) @ right + 2e-3).reshape(400, 80, 3).astype(np.float32)


def test_components_span_the_leading_singular_vectors_of_the_training_frames():
    rng = np.random.default_rng(0)
    offsets_m, frames = _offsets(rng), rng.permutation(400)[:300]
    codec = PcaCodec.fit(offsets_m, frames, size=10)
    flat = offsets_m[np.sort(frames)].reshape(300, -1).astype(np.float64)
    right = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][:10]
    np.testing.assert_allclose(codec.components @ codec.components.T, np.eye(10), atol=1e-5)
    np.testing.assert_allclose(np.abs(np.diag(codec.components @ right.T)), 1, atol=1e-4)


def test_all_components_reconstruct_and_fewer_lose():
    rng = np.random.default_rng(1)
    offsets_m, frames = _offsets(rng), np.arange(400)
    scores = [
        reconstruction_r2(PcaCodec.fit(offsets_m, frames, size), offsets_m, frames)
        for size in (2, 10, 60)
    ]
    assert scores[0] < scores[1] < scores[2]
    np.testing.assert_allclose(scores[2], 1, atol=1e-6)


def test_given_directions_are_kept_in_their_order():
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((80, 3, 4)) @ rng.standard_normal((4, 4))
    codec = PcaCodec.of_directions(directions)
    assert codec.latent_size == 4
    np.testing.assert_allclose(codec.components @ codec.components.T, np.eye(4), atol=1e-6)
    first = directions[..., 0].ravel() / np.linalg.norm(directions[..., 0])
    np.testing.assert_allclose(codec.components[0], first, atol=1e-6)
    offsets_m = (1e-3 * directions @ rng.standard_normal((4, 9))).transpose(2, 0, 1)
    kept = codec.decode(codec.encode(offsets_m.astype(np.float32)))
    np.testing.assert_allclose(kept, offsets_m, atol=1e-8)


def test_codec_keeps_shapes_and_seed_decides():
    offsets_m = _offsets(np.random.default_rng(2))
    one, same = (PcaCodec.fit(offsets_m, np.arange(50), size=5) for _ in range(2))
    np.testing.assert_array_equal(one.components, same.components)
    latents = one.encode(offsets_m[:7])
    assert latents.shape == (7, 5)
    assert one.decode(latents).shape == (7, 80, 3)
