"""Random weights and inputs; no value is 0 or 1, which could hide a mistake."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, pose_vertices
from bridge.body.model_data import POSE_FEATURE_COUNT
from bridge.exchange.weights import autoencoder_shapes, dsnet_shapes
from bridge.paper import DSNET_WIDTHS, INPUT_SIZE, LATENT_SIZE, N_BETAS, THETA_SIZE
from bridge.tissue.oscillators import STEPS

Arrays = dict[str, NDArray[Any]]
SMALL_WIDTHS = (40, 24, 24, 12, 6)
"""A small autoencoder. One kernel is square, so that transposing it by mistake raises no error."""

_COEFFICIENTS = {
    "omega": 30.0, "damping_ratio": 0.15, "stiffening": 500.0, "sag": 0.03,
    "normal_ratio": 1.4, "wave_speed": 1.0, "bending": 1e-4,
    "inertia_gain": 0.9, "gravity_gain": 1.1,
}  # fmt: skip


def dsnet_weights(seed: int) -> Arrays:
    """Weights that keep every layer's output of order one; statistics far from 0 and 1."""
    rng = np.random.default_rng([seed, 1])
    drawn = {name: _draw(rng, shape, shape[0]) for name, shape in dsnet_shapes().items()}
    for name in ("gamma", "moving_variance"):
        drawn[f"batch_norm/{name}"] = rng.uniform(0.1, 2.0, DSNET_WIDTHS["lstm"]).astype(np.float32)
    return drawn


def scaling(seed: int) -> Arrays:
    """The scaling of a network that was trained on standardised values."""
    rng, sizes = np.random.default_rng([seed, 13]), {"input": INPUT_SIZE, "latent": LATENT_SIZE}
    return {
        **{f"scaling/{name}_mean": _normal(rng, (size,), 0.5) for name, size in sizes.items()},
        **{
            f"scaling/{name}_std": rng.uniform(0.5, 2.0, size).astype(np.float32)
            for name, size in sizes.items()
        },
    }


def autoencoder_weights(seed: int, widths: tuple[int, ...]) -> Arrays:
    """Weights that keep the size of a signal through all the network's fourteen layers."""
    rng = np.random.default_rng([seed, 2])
    shapes = autoencoder_shapes(widths).items()
    return {name: _draw(rng, shape, math.prod(shape[1:]) / 2) for name, shape in shapes}


def motion(seed: int, clips: int, frames: int, size: float = 0.5) -> Arrays:
    """Inputs of DSNet, (B, T, 79)."""
    rng = np.random.default_rng([seed, 3, clips, frames])
    return {"motion": _normal(rng, (clips, frames, INPUT_SIZE), size)}


def clips(seed: int, count: int, frames: int) -> Arrays:
    """Training clips, each shorter than the one before and padded with zeros."""
    rng = np.random.default_rng([seed, 4])
    lengths = np.linspace(frames, frames / 3, count).astype(int)
    real = np.arange(frames) < lengths[:, None]
    drawn = (_normal(rng, (count, frames, width), 0.5) for width in (INPUT_SIZE, LATENT_SIZE))
    motion, latents = (array * real[..., None] for array in drawn)
    return {"motion": motion, "latents": latents, "real": real}


def values(seed: int, count: int, vertices: int, size: float = 1.0) -> Arrays:
    """Normalised offsets (B, V, 3)."""
    return {"values": _normal(np.random.default_rng([seed, 5]), (count, vertices, 3), size)}


def bodies(seed: int, body: BodyModelData, pose: NDArray) -> Arrays:
    """Bodies in poses (B, 22 or 24, 3): betas, trans, offsets, a mesh to unpose, a direction."""
    rng = np.random.default_rng([seed, 6])
    count, surface = len(pose), (len(pose), *body.v_template.shape)
    given = {
        "betas": _normal(rng, (count, N_BETAS), 1.0),
        "pose": pose.astype(np.float32),
        "trans": _normal(rng, (count, 3), 1.0),
        "offsets": _normal(rng, surface, 0.01),
    }
    noise = _normal(rng, surface, 0.005)
    mesh = (pose_vertices(body, **given) + noise).astype(np.float32)
    return {**given, "mesh": mesh, "probe": _normal(rng, surface, 1.0)}


def frames(seed: int, body: BodyModelData, count: int) -> Arrays:
    """Meshes (B, V, 3) of bodies with soft tissue, and where a descent to them starts."""
    rng = np.random.default_rng([seed, 12])
    given = bodies(seed, body, poses(seed, count, 22, 0.5))
    shape = {"pose": given["pose"].shape, "trans": given["trans"].shape}
    near = {name: given[name] + _normal(rng, shape[name], 0.05) for name in shape}
    return {"mesh": given["mesh"], "betas": given["betas"], **near}


def stream(seed: int, frames: int, characters: int) -> Arrays:
    """Moving characters: theta (T, B, 69), betas (B, 10)."""
    rng = np.random.default_rng([seed, 8])
    sway = np.cumsum(_normal(rng, (frames, characters, THETA_SIZE), 0.02), axis=0)
    start = _normal(rng, (characters, THETA_SIZE), 0.3)
    return {
        "theta": (start + sway).astype(np.float32),
        "betas": _normal(rng, (characters, N_BETAS), 1.0),
    }


def tissue(seed: int, body: BodyModelData, nodes: int = 40) -> Arrays:
    """Arrays of a random `dsnet_plus`: soft tissue on a ring of nodes, and a static part."""
    rng = np.random.default_rng([seed, 9])
    vertices, ring = body.vertex_count, np.arange(nodes)
    edges = [np.stack([ring, (ring + step) % nodes], axis=1) for step in (-1, 0, 1)]
    pulls = np.repeat(np.array([-1.0, 2.0, -1.0], np.float32) * 1e3, nodes)
    first = np.sort(rng.integers(0, nodes, vertices))
    shares = rng.dirichlet(np.ones(8), vertices)
    return {
        "nodes/vertices": np.sort(rng.choice(vertices, nodes, replace=False)).astype(np.int32),
        "nodes/owners": np.sort((first[:, None] + np.arange(8)) % nodes, axis=1).astype(np.int32),
        "nodes/shares": shares.astype(np.float32),
        "nodes/areas_m2": rng.uniform(1e-4, 4e-4, vertices).astype(np.float32),
        "nodes/edges": np.concatenate(edges).astype(np.int32),
        "nodes/pulls_m2": pulls,
        **_logarithms(rng, (nodes, 1)),
        "slopes": _normal(rng, (3, 1), 0.2),
        "stiffening_power": np.array([1.5], np.float32),
        "residual": _normal(rng, (2, nodes, 1), 0.1),
        "taps": np.array([0.5, 0.3, 0.2], np.float32),
        "constant_m": _normal(rng, (2, vertices, 3), 1e-3),
        "by_pose_m": _normal(rng, (POSE_FEATURE_COUNT, nodes, 3), 1e-4),
        "people_betas": _normal(rng, (2, N_BETAS), 1.0),
        "look_ahead": np.array([1], np.int32),
        "steps": np.array([STEPS], np.int32),
    }


def directions(seed: int, plus: Arrays, given: Arrays, count: int = 2) -> Arrays:
    """A `probe` of the offsets of motions, and some directions of all that these depend on."""
    rng = np.random.default_rng([seed, 12])
    frames, people, _ = given["theta"].shape
    learned = ("slopes", "stiffening_power", "residual", "taps")
    names = [*(f"log_{name}" for name in _COEFFICIENTS), *learned]
    variables = given | {name: plus[name] for name in names}
    probe = rng.uniform(0, 1, (frames, people, len(plus["nodes/owners"]), 3)).astype(np.float32)
    return {"probe": probe} | {
        f"towards/{name}": _normal(rng, (count, *array.shape), 0.03 if name == "theta" else 1.0)
        for name, array in variables.items()
    }


def oscillators(seed: int, nodes: int = 6, people: int = 2) -> Arrays:
    """Weights of the Keras layer that is trained as `dsnet_plus`, by their Keras names."""
    rng = np.random.default_rng([seed, 10])
    return {
        **_logarithms(rng, (1,)),
        **{f"by_node_{name}": _normal(rng, (nodes, 1), 0.2) for name in _COEFFICIENTS},
        "slopes": _normal(rng, (3, 1), 0.2),
        "stiffening_power": np.array([1.5], np.float32),
        "residual": _normal(rng, (people, nodes, 1), 0.1),
        "taps": np.array([0.5, 0.3, 0.4], np.float32),
    }


def windows(seed: int, frames: int = 6, nodes: int = 6, clips: int = 3, people: int = 2) -> Arrays:
    """A training batch of that layer, in which one window is shorter than the others."""
    rng = np.random.default_rng([seed, 11])
    normals = _normal(rng, (nodes, clips, 3), 1.0)
    counted = np.ones((frames, 1, clips, 1), np.float32)
    counted[-2:, :, 0] = 0
    pulls = np.abs(_normal(rng, (nodes, nodes), 1e3))
    return {
        "laplacian": np.diag(pulls.sum(1)) - pulls,
        "inertia": _normal(rng, (frames + 2, nodes, clips, 3), 20.0),
        "gravity": _normal(rng, (frames + 2, nodes, clips, 3), 5.0),
        "now": _normal(rng, (nodes, clips, 3), 0.02),
        "before": _normal(rng, (nodes, clips, 3), 0.02),
        "target": _normal(rng, (frames, nodes, clips, 3), 0.02),
        "counted": counted,
        "normals": normals / np.linalg.norm(normals, axis=-1, keepdims=True),
        "features": _normal(rng, (nodes, clips, 3), 0.3),
        "shares": _normal(rng, (clips, people), 0.5),
    }


def poses(seed: int, count: int, joints: int, angle: float) -> NDArray[np.float64]:
    """Axis-angle vectors (B, joints, 3) of one angle about random axes; row 0 about x, y or z."""
    axes = np.random.default_rng([seed, 7]).normal(size=(count, joints, 3))
    axes[0] = np.eye(3)[np.arange(joints) % 3]
    return angle * axes / np.linalg.norm(axes, axis=-1, keepdims=True)


def _logarithms(rng: np.random.Generator, shape: tuple[int, ...]) -> Arrays:
    return {
        f"log_{n}": math.log(value) + _normal(rng, shape, 0.2) for n, value in _COEFFICIENTS.items()
    }


def _draw(rng: np.random.Generator, shape: tuple[int, ...], fan_in: float) -> NDArray[np.float32]:
    return _normal(rng, shape, 0.2 if len(shape) == 1 else 1 / math.sqrt(fan_in))


def _normal(rng: np.random.Generator, shape: tuple[int, ...], size: float) -> NDArray[np.float32]:
    drawn = rng.standard_normal(shape, dtype=np.float32)
    drawn *= np.float32(size)
    return drawn
