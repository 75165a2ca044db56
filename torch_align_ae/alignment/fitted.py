"""What every aligner gives: fitted frames, and the artifact's files that they are written to."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.errors import DsnetError
from bridge.motion import MotionSequence
from bridge.paper import THETA_SIZE
from bridge.runs import ArtifactWriter
from bridge.runs.files import ArrayFile, arrays_sha256, json_sha256
from torch_align_ae.body import SMPL, rest_pose_offsets

# A mesh registered to SMPL's template fits to centimetres, whatever its soft tissue does.
_WORST_MEAN_M = 0.2


@dataclass(frozen=True)
class FittedPoses:
    """Poses of consecutive frames of one sequence."""

    track: int
    """Index of the sequence."""
    start: int
    """First frame, counted within the sequence."""
    pose: Tensor
    """(n, 22, 3) axis-angle, radians."""
    trans: Tensor
    """(n, 3) metres."""


@dataclass(frozen=True)
class Fitted(FittedPoses):
    """Consecutive frames of one sequence, fitted."""

    offsets: Tensor
    """(n, V, 3) metres in the rest pose, Eq. 5."""
    frame_error: Tensor
    """(n,) mean distance of the posed body's vertices to the mesh, metres."""


@dataclass(frozen=True)
class StoredFrames(FittedPoses):
    """Consecutive frames of one sequence whose offsets and errors are written."""

    digest: str
    """Of what was written."""


def measure(
    smpl: SMPL, index: int, start: int, betas: Tensor, pose: Tensor, trans: Tensor, mesh: Tensor
) -> Fitted:
    """Offsets and errors of consecutive frames, their shape and poses being known.

    Parameters
    ----------
    index : of the sequence.
    start : first frame, counted within the sequence.
    betas : (10,) shape of its subject.
    pose : (n or more, 22, 3) axis-angle, radians; rows beyond the mesh's frames are cut off.
    trans : (n or more, 3) metres.
    mesh : (n, V, 3) metres.
    """
    pose, trans = pose[: len(mesh)], trans[: len(mesh)]
    shapes = betas.expand(len(mesh), -1)
    offsets, distances = rest_pose_offsets(smpl, mesh, shapes, pose, trans)
    return Fitted(index, start, pose, trans, offsets, distances.mean(1))


def check_distances(name: str, start: int, distances_m: Tensor) -> None:
    """Check the mean distances (n,) of consecutive frames of a sequence from the fitted body.

    Raises
    ------
    DsnetError
        If a frame is further away than any soft tissue explains.
    """
    fits = distances_m < _WORST_MEAN_M
    if not fits.all():
        # What is not a number counts as the worst.
        worst = int(distances_m.nan_to_num(torch.inf, torch.inf).argmax())
        raise DsnetError(
            f"{name}, whose frame {start + worst} stays {100 * distances_m[worst]:.0f} cm from"
            " SMPL",
            "meshes with SMPL's vertex order",
            "Register the meshes to SMPL's template, leave this sequence out, or take more steps.",
        )


@dataclass(frozen=True)
class AlignedFiles:
    """`theta`, `offsets` and `frame_error` of the artifact, which workers anywhere fill."""

    theta: ArrayFile
    """(F, 69) radians, and metres."""
    offsets: ArrayFile
    """(F, V, 3) metres."""
    frame_error: ArrayFile
    """(F,) metres."""

    @classmethod
    def of(
        cls, writer: ArtifactWriter, sequences: list[MotionSequence], vertex_count: int
    ) -> AlignedFiles:
        """Those of the artifact being written; what they hold already stays."""
        frames = sequences[-1].frames.stop
        vertices = (frames, vertex_count, 3)
        return cls(
            writer.array_file("theta", (frames, THETA_SIZE), np.float32, "rad and m"),
            writer.array_file("offsets", vertices, np.float32, "m"),
            writer.array_file("frame_error", (frames,), np.float32, "m"),
        )

    def store(self, sequence: MotionSequence, fitted: Fitted) -> StoredFrames:
        """Write what is large; what is left is small enough to be sent.

        Raises
        ------
        DsnetError
            If the fit of a frame is none.
        """
        check_distances(sequence.name, fitted.start, fitted.frame_error)
        first = sequence.start + fitted.start
        offsets, frame_error = fitted.offsets.numpy(), fitted.frame_error.numpy()
        self.offsets.write(first, offsets)
        self.frame_error.write(first, frame_error)
        digest = arrays_sha256({"offsets": offsets, "frame_error": frame_error})
        return StoredFrames(fitted.track, fitted.start, fitted.pose, fitted.trans, digest)

    def digest(self, rows: slice) -> str:
        """`StoredFrames.digest` of the rows as they are in the files now."""
        found = {"offsets": self.offsets.read(rows), "frame_error": self.frame_error.read(rows)}
        return arrays_sha256(found)


def seal(digests: Iterable[str], thetas: Iterable[NDArray[np.float32]]) -> str:
    """What a checkpoint says of frames that are written: if any of it changes, it does not hold."""
    poses = {str(index): theta for index, theta in enumerate(thetas)}
    return json_sha256([*digests, arrays_sha256(poses)])
