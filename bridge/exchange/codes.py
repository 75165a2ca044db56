"""The codes of offsets that a run holds: what a predictor's latents stand for."""

from __future__ import annotations

from typing import Literal

CodeName = Literal["autoencoder", "pca", "dmpl"]
AUTOENCODER: CodeName = "autoencoder"
"""The paper's: the mesh autoencoder's latents."""
PCA: CodeName = "pca"
"""Coefficients in metres of the leading principal components, as many as the latents are; distances
between them are distances between offsets."""
DMPL: CodeName = "dmpl"
"""Coefficients in metres of DMPL's released directions, made orthonormal in their order; only in
runs that were given the licensed file."""
LATENTS_OF: dict[CodeName, str] = {AUTOENCODER: "latents", PCA: "latents_pca", DMPL: "latents_dmpl"}
"""Array of the `encode` artifact that holds a code's latents."""
UNITS: dict[CodeName, str] = {AUTOENCODER: "1", PCA: "m", DMPL: "m"}
"""Of a code's latents."""
LINEAR_FILES: dict[CodeName, str] = {PCA: "pca.safetensors", DMPL: "dmpl.safetensors"}
"""Of the `train-ae` artifact: `components` (K, V * 3), `mean_m` (V, 3)."""
