"""Clips of a synthetic corpus whose truth is known, and the errors of poses found for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.meshes.dyna_files import dyna_sequences
from bridge.motion import sequences_of, subject_rows, unpack_theta
from bridge.motion.cuts import turns_rad
from bridge.runs import Run
from bridge.runs.run import corpus_body_path
from dsnet.evaluation.metrics import ErrorSums
from torch_align_ae.body import SMPL, rest_pose_offsets


@dataclass(frozen=True)
class KnownClips:
    """The same frames of several sequences, N clips of T frames, S subjects."""

    names: list[str]
    """Names of the sequences."""
    subjects: list[int]
    """Row of each clip's subject in `betas`."""
    first_frames: Tensor
    """(S, V, 3) frame 1 of each subject's first clip, metres: the paper's shapes come from it."""
    before: Tensor
    """(N, V, 3) mesh before the clip's first, metres."""
    meshes: Tensor
    """(N, T, V, 3) metres."""
    betas: Tensor
    """(S, 10) true shapes."""
    pose: NDArray[np.float32]
    """(N, T, 22, 3) true poses, radians."""
    offsets_m: NDArray[np.float32]
    """(N, T, V, 3) true offsets in the rest pose, metres."""

    def errors(self, smpl: SMPL, betas: Tensor, pose: Tensor, trans: Tensor) -> dict[str, Any]:
        """Errors of betas (S, 10), pose (N, T, 22, 3) and trans (N, T, 3), over all frames."""
        together, r2_of_clip, distances = ErrorSums(), {}, []
        for row, (subject, mesh) in enumerate(zip(self.subjects, self.meshes, strict=True)):
            shapes = betas[subject].expand(len(mesh), -1)
            found, apart = rest_pose_offsets(smpl, mesh, shapes, pose[row], trans[row])
            offsets = ErrorSums()
            offsets.add(found, self.offsets_m[row])
            together += offsets
            r2_of_clip[self.names[row]] = offsets.r2
            distances.append(apart.mean(1))
        return {
            "r2": together.r2,
            "pose_deg": float(np.degrees(turns_rad(pose.numpy(), self.pose)).mean()),
            "mesh_mm": 1e3 * float(torch.cat(distances).mean()),
            "r2_of_clip": r2_of_clip,
        }


def load_clips(run: Run, names: list[str], frames: slice) -> tuple[SMPL, KnownClips]:
    """Body model of a run's corpus, and clips with their truth.

    Raises
    ------
    DsnetError
        If the run has no synthetic corpus, or not these sequences or frames.
    """
    corpus, truth = run.artifact("corpus"), run.artifact("truth")
    index = {sequence.name: sequence for sequence in sequences_of(truth)}
    missing = [name for name in names if name not in index or index[name].length < frames.stop]
    if missing:
        raise DsnetError(
            f"run {run.name!r}, whose corpus lacks frames {frames.start} to {frames.stop} of "
            f"{', '.join(missing)}",
            "sequences that reach so far",
            "Choose others, or make the corpus with --profile demo.",
        )
    chosen = [index[name] for name in names]
    subjects = subject_rows(chosen)
    rows = [subjects[sequence.subject] for sequence in chosen]
    leading = [names[rows.index(row)] for row in range(len(subjects))]
    files = [corpus.file(name) for name in corpus.manifest["files"] if name.endswith(".h5")]
    stored = {sequence.name: sequence for sequence in dyna_sequences(files)}
    first = np.concatenate([stored[name].read(0, 1) for name in leading])
    meshes = np.stack([stored[name].read(frames.start - 1, frames.stop) for name in names])
    own = [slice(s.start + frames.start, s.start + frames.stop) for s in chosen]
    betas = truth.array("betas")[[subject_rows(index.values())[name] for name in subjects]]
    return SMPL(load_body_model(corpus_body_path(corpus))), KnownClips(
        names,
        rows,
        torch.from_numpy(first),
        torch.from_numpy(meshes[:, 0]),
        torch.from_numpy(meshes[:, 1:]),
        torch.from_numpy(betas).float(),
        np.stack([unpack_theta(truth.array("theta")[part])[0] for part in own]),
        np.stack([truth.array("offsets")[part] for part in own]),
    )
