"""The codes of offsets that a run holds: what a predictor's latents stand for."""

from __future__ import annotations

from typing import Literal

CodeName = Literal["autoencoder", "pca"]
AUTOENCODER: CodeName = "autoencoder"
"""The paper's: the mesh autoencoder's latents."""
PCA: CodeName = "pca"
"""Coefficients in metres of the leading principal components, as many as the latents are; distances
between them are distances between offsets."""
LATENTS_OF: dict[CodeName, str] = {AUTOENCODER: "latents", PCA: "latents_pca"}
"""Array of the `encode` artifact that holds a code's latents."""
UNITS: dict[CodeName, str] = {AUTOENCODER: "1", PCA: "m"}
"""Of a code's latents."""
PCA_FILE = "pca.safetensors"
"""Of the `train-ae` artifact: `components` (K, V * 3), `mean_m` (V, 3)."""
