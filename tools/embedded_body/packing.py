"""Quantise a body and write it as an asset; `bridge.body.embedded` documents the layout."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from tools.embedded_body.shape_space import JointRegressor, ShapeSpace

SHAPEDIRS_STEP_M = 1e-5
POSEDIRS_STEP_M = 5e-5
WEIGHTS_PER_VERTEX = 4


def limit_weights(weights: np.ndarray) -> np.ndarray:
    """Keep each vertex's strongest joints and renormalise, so that rows sum to one.

    What equals the strongest that goes, goes as well: left and right are one or the other alike.
    """
    dropped = np.sort(weights, axis=1)[:, [-WEIGHTS_PER_VERTEX - 1]]
    limited = np.where(weights > dropped, weights, 0.0)
    limited = np.round(limited / limited.sum(axis=1, keepdims=True) * 65535)
    return limited / limited.sum(axis=1, keepdims=True)


def pack(
    shapes: ShapeSpace,
    regressor: JointRegressor,
    posedirs: np.ndarray,
    weights: np.ndarray,
    faces: np.ndarray,
    makehuman_index: np.ndarray,
) -> dict[str, np.ndarray]:
    """Arrays of an asset, from float64 arrays in metres; `posedirs` is (V, 3, 207)."""
    order = np.argsort(-weights, axis=1, kind="stable")[:, :WEIGHTS_PER_VERTEX]
    strongest = np.take_along_axis(weights, order, axis=1)
    shapedirs = _quantise(np.moveaxis(shapes.shapedirs, -1, 0), SHAPEDIRS_STEP_M)
    return {
        "v_template": shapes.template.astype(np.float32),
        "faces": faces.astype(np.uint16),
        "shapedirs": shapedirs,
        "shapedirs_step_m": np.array(SHAPEDIRS_STEP_M),
        **_pack_posedirs(posedirs),
        "weight_joint": order.astype(np.uint8),
        "weight_value": np.round(strongest * 65535).astype(np.uint16),
        "regressor_vertex": regressor.vertex.astype(np.uint16),
        "regressor_value": regressor.value.astype(np.float32),
        "makehuman_index": makehuman_index.astype(np.uint16),
    }


def write_asset(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a compressed `.npz`; NumPy dates its members 1980, so equal arrays give equal bytes."""
    np.savez_compressed(path, allow_pickle=False, **arrays)


def _pack_posedirs(posedirs: np.ndarray) -> dict[str, np.ndarray]:
    vertex_count = len(posedirs)
    blocks = _quantise(posedirs, POSEDIRS_STEP_M).reshape(vertex_count, 3, -1, 9)
    blocks = blocks.transpose(2, 0, 1, 3).reshape(-1, vertex_count, 27)
    joint, vertex = np.nonzero(blocks.any(axis=2))
    return {
        "posedirs": np.ascontiguousarray(blocks[joint, vertex].T),
        "posedirs_vertex": vertex.astype(np.uint16),
        "posedirs_count": np.bincount(joint, minlength=len(blocks)).astype(np.uint16),
        "posedirs_step_m": np.array(POSEDIRS_STEP_M),
    }


def _quantise(values_m: np.ndarray, step_m: float) -> np.ndarray:
    steps = np.round(values_m / step_m)
    if (largest := np.abs(steps).max()) > np.iinfo(np.int16).max:
        raise ValueError(f"{largest:.0f} steps of {step_m} m do not fit 16 bits")
    return steps.astype(np.int16)


def write_checksums(out: Path) -> None:
    """Of all assets in a folder, into its SHA256SUMS."""
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in sorted(out.glob("embedded_*.*"))
    ]
    (out / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")
