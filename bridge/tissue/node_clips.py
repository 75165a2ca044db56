"""Aligned sequences as the oscillators learn from them: at the nodes, with their loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.motion import MotionSequence, sequences_of, subject_shapes, subjects_of
from bridge.runs import Artifact
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.oscillators import Load, node_loads
from bridge.tissue.trained_plus import static_features

_FRAMES_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class NodeClip:
    """One sequence of a known person, T frames at K nodes."""

    sequence: MotionSequence
    person: int  # row among the known people
    theta: NDArray[np.floating]  # (T, 69)
    offsets_m: NDArray[np.float32]  # (T, K, 3) aligned offsets at the nodes
    load: Load  # (T, K, 3) twice
    features: NDArray[np.float32]  # (T, 207) pose features, for the static part

    def __len__(self) -> int:
        return len(self.offsets_m)


def known_people(align: Artifact) -> tuple[list[str], NDArray[np.float32]]:
    """Those who are trained on, in order of first appearance, and their betas (P, 10)."""
    sequences = sequences_of(align)
    names = subjects_of(s for s in sequences if s.split == "train")
    shapes = subject_shapes(sequences, align.array("betas"))
    return names, np.array([shapes[name] for name in names], np.float32)


def node_clips(
    align: Artifact, body: BodyModelData, nodes: TissueNodes, names: list[str], betas: NDArray
) -> list[NodeClip]:
    """The training sequences of four frames or more; names and betas (P, 10) are their people's."""
    chosen = [s for s in sequences_of(align) if s.split == "train" and s.length >= 4]
    if not chosen:
        raise DsnetError(
            f"{align.path} without a sequence of split 'train'",
            "at least one of four frames",
            "Align more sequences.",
        )
    clips, all_theta, all_offsets_m = [], align.array("theta"), align.array("offsets")
    for sequence in chosen:
        person = names.index(sequence.subject)
        theta = np.asarray(all_theta[sequence.frames], np.float64)
        at_nodes = [nodes.gather(all_offsets_m[rows]) for rows in sequence.pieces(_FRAMES_AT_ONCE)]
        load = node_loads(body, nodes.vertices, betas[person], theta, sequence.fps)
        features, offsets_m = static_features(body, theta), np.concatenate(at_nodes)
        clips.append(NodeClip(sequence, person, theta, offsets_m, load, features))
    return clips
