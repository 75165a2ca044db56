"""What every aligner gives: fitted frames, and the artifact's arrays that they are written to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge.errors import DsnetError
from bridge.motion import MotionSequence, pack_theta
from bridge.paper import THETA_SIZE
from bridge.runs import ArtifactWriter
from torch_align_ae.body import SMPL, rest_pose_offsets

# A mesh registered to SMPL's template fits to centimetres, whatever its soft tissue does.
_WORST_MEAN_M = 0.2


@dataclass(frozen=True)
class Fitted:
    """Consecutive frames of one sequence, fitted."""

    track: int
    """Index of the sequence."""
    start: int
    """First frame, counted within the sequence."""
    pose: Tensor
    """(n, 22, 3) axis-angle, radians."""
    trans: Tensor
    """(n, 3) metres."""
    offsets: Tensor
    """(n, V, 3) metres in the rest pose, Eq. 5."""
    frame_error: Tensor
    """(n,) mean distance of the posed body's vertices to the mesh, metres."""


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


class AlignedArrays:
    """`theta`, `offsets` and `frame_error` of the artifact, memory-mapped.

    Pages of a map count as memory until it is closed, so open it anew for every few frames.
    """

    def __init__(
        self, writer: ArtifactWriter, sequences: list[MotionSequence], vertex_count: int
    ) -> None:
        self._sequences = sequences
        frames = sequences[-1].frames.stop
        vertices = (frames, vertex_count, 3)
        self._theta = writer.open_array("theta", (frames, THETA_SIZE), np.float32, "rad and m")
        self._offsets = writer.open_array("offsets", vertices, np.float32, "m")
        self._frame_error = writer.open_array("frame_error", (frames,), np.float32, "m")

    def write(self, fitted: Fitted) -> NDArray[np.float32]:
        """Store the rows of some frames; returns the last one's theta (69,).

        Raises
        ------
        DsnetError
            If the fit of a frame is none.
        """
        sequence = self._sequences[fitted.track]
        check_distances(sequence.name, fitted.start, fitted.frame_error)
        begin = sequence.start + fitted.start
        rows = slice(begin, begin + len(fitted.pose))
        self._theta[rows] = pack_theta(fitted.pose.numpy(), fitted.trans.numpy())
        self._offsets[rows] = fitted.offsets.numpy()
        self._frame_error[rows] = fitted.frame_error.numpy()
        return self._theta[rows.stop - 1]

    def rows(self, rows: slice) -> tuple[NDArray[np.float32], ...]:
        """The same rows of each array."""
        return self._theta[rows], self._offsets[rows], self._frame_error[rows]

    def flush(self) -> None:
        """Bring everything that was written to the disk."""
        for array in (self._theta, self._offsets, self._frame_error):
            if isinstance(array, np.memmap):
                array.flush()
