"""People whose tissue is made of oscillators that a test knows, as clips and as alignments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.motion import MotionSequence
from bridge.motion.sequences import Split
from bridge.tissue.node_clips import NodeClip
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.oscillators import node_loads
from bridge.tissue.trained_plus import (
    NODE_FIELDS,
    StaticPart,
    TrainedPlus,
    Weights,
    static_features,
)
from dsnet.verify.reference.oscillators import node_offsets
from tests.forged.artifacts import put

HZ = 5.5
TRUE = {
    "omega": 2 * np.pi * HZ,
    "damping_ratio": 0.2,
    "stiffening": 400.0,
    "sag": 0.01,
    "normal_ratio": 1.5,
    "wave_speed": 0.8,
    "bending": 4e-3,
    "inertia_gain": 1.0,
    "gravity_gain": 1.0,
}
"""Of every node; none of it is where training starts but for the gains."""
SLOPES = np.array([[-0.8], [0.0], [0.0]], np.float32)
"""Deep flesh is soft, and nothing else matters."""
MOTIONS = ("hips", "punching", "running")


def people_of(count: int) -> NDArray[np.float32]:
    """(count, 10) shapes, slim and stout."""
    betas = np.random.default_rng(7).normal(scale=0.3, size=(count, 10))
    betas[:, 1] += np.linspace(-2.5, 2.5, count)
    return betas.astype(np.float32)


def true_model(nodes: TissueNodes, people: NDArray[np.float32]) -> TrainedPlus:
    """Even tissue whose softness follows shape alone, driven without looking ahead."""
    count = len(nodes)
    base = {name: np.full((count, 1), np.log(TRUE[name]), np.float32) for name in NODE_FIELDS}
    residual = np.zeros((len(people), count, 1), np.float32)
    power, taps = np.array([2.0], np.float32), np.array([1.0], np.float32)
    weights = Weights(base, SLOPES, power, residual, taps)
    return TrainedPlus(nodes, weights, StaticPart.nothing(), people, look_ahead=0)


def lively(frames: int, seed: int) -> NDArray[np.float64]:
    """(T, 69) joints, root and place that swing at 0.5 to 2.5 Hz."""
    rng = np.random.default_rng([11, seed])
    hz, phases = rng.uniform(0.5, 2.5, (1, 69)), rng.uniform(0, 2 * np.pi, (1, 69))
    size = np.concatenate([np.full(66, 0.25), [0.05, 0.12, 0.05]])
    return size * np.sin(2 * np.pi * hz * np.arange(frames)[:, None] / 60 + phases)


def clip_of(
    body: BodyModelData,
    model: TrainedPlus,
    betas: NDArray,
    theta: NDArray,
    *,
    person: int = 0,
    motion: str = "hips",
) -> NodeClip:
    """A clip whose offsets are what the model makes of the motion."""
    sequence = MotionSequence(f"{person}_{motion}", str(person), motion, 0, len(theta), 60.0)
    load = node_loads(body, model.nodes.vertices, betas, theta, 60.0)
    offsets_m = node_offsets(model, body, theta, betas).astype(np.float32)
    features = static_features(body, theta)
    return NodeClip(sequence, person, theta, offsets_m, load, features)


def clips_of(body: BodyModelData, model: TrainedPlus, frames: int = 100) -> list[NodeClip]:
    """Each known person with every kind of motion, each time another take."""
    return [
        clip_of(body, model, betas, lively(frames, 10 * p + m), person=p, motion=motion)
        for p, betas in enumerate(model.people_betas)
        for m, motion in enumerate(MOTIONS)
    ]


def write_aligned(
    path: Path,
    body: BodyModelData,
    model: TrainedPlus,
    *,
    kind: str = "align_robust",
    lengths: Sequence[int] = (50, 40, 45),
    misfit_m: float = 0.0,
    **record: Any,
) -> None:
    """An alignment of every known person's motions, the last motion of the last one held out.

    Offsets are the model's, and `misfit_m` along y over and over, which no load explains.
    """
    sequences, theta, offsets, start = [], [], [], 0
    for person, betas in enumerate(model.people_betas):
        for number, (motion, length) in enumerate(zip(MOTIONS, lengths, strict=True)):
            last = person == len(model.people_betas) - 1 and number == len(MOTIONS) - 1
            split: Split = "validation" if last else "train"
            subject = f"5000{person}"
            sequences.append(
                MotionSequence(f"{subject}_{motion}", subject, motion, start, length, 60.0, split)
            )
            theta.append(lively(length, 10 * person + number).astype(np.float32))
            offsets.append(model.nodes.spread(node_offsets(model, body, theta[-1], betas)))
            start += length
    arrays = {
        "betas": model.people_betas,
        "theta": np.concatenate(theta),
        "offsets": np.concatenate(offsets) + np.array([0.0, 0.0, misfit_m], np.float32),
    }
    assert path.name == kind
    put(path, arrays, sequences, **record)
