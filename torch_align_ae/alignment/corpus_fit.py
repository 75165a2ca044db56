"""Common to both aligners: filling an artifact window by window, with checkpoints.

First an aligner calibrates the subjects; the result is one checkpoint. Then it fits windows of
frames. For each finished group of windows a digest of the arrays is stored as a checkpoint. A group
whose digest is missing or does not match is fitted again, with the same result.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from bridge.errors import DsnetError, notify
from bridge.exchange.weights import load_checkpoint, save_checkpoint
from bridge.motion import MotionSequence, to_manifest, unpack_theta
from bridge.motion.cuts import repeated_frames
from bridge.motion.motion_checks import MOST_FALL_G, is_head_down, steepest_fall_g
from bridge.paper import THETA_SIZE
from bridge.runs import ArtifactWriter
from bridge.runs.files import ArrayFile, arrays_sha256, is_written, json_sha256, mark_written
from torch_align_ae.body import SMPL, rest_pose_offsets

# A mesh registered to SMPL's template fits to centimetres, whatever its soft tissue does.
_WORST_MEAN_M = 0.2
# Every how many vertices are compared to find repeated meshes.
_EVERY_VERTEX = 100


class Meshes(Protocol):
    """The meshes of one sequence."""

    def read(self, start: int, stop: int, every: int = 1) -> NDArray[np.float32]:
        """Frames [start, stop) as (n, V, 3), metres, with every `every`-th vertex.

        It may be called in any thread or process.
        """
        ...


class Window(NamedTuple):
    """Consecutive frames of one sequence, by their numbers in it."""

    sequence: MotionSequence
    start: int
    stop: int

    @property
    def rows(self) -> slice:
        """The same frames in the artifact's arrays."""
        return slice(self.sequence.start + self.start, self.sequence.start + self.stop)


def windows(sequence: MotionSequence, frames: int) -> list[Window]:
    """A sequence cut into windows of `frames`."""
    starts = range(0, sequence.length, frames)
    return [Window(sequence, at, min(at + frames, sequence.length)) for at in starts]


@dataclass(frozen=True)
class AlignedFiles:
    """`theta`, `offsets` and `frame_error` of the artifact, which workers on any machine fill."""

    theta: ArrayFile  # (F, 69) radians, and metres
    offsets: ArrayFile  # (F, V, 3) metres in the rest pose, Eq. 5
    frame_error: ArrayFile  # (F,) mean distance of the posed body's vertices to the mesh, metres

    @classmethod
    def of(cls, writer: ArtifactWriter, frames: int, vertex_count: int) -> AlignedFiles:
        """Open the arrays of the artifact being written, with what they already contain."""
        return cls(
            writer.array_file("theta", (frames, THETA_SIZE), np.float32, "rad and m"),
            writer.array_file("offsets", (frames, vertex_count, 3), np.float32, "m"),
            writer.array_file("frame_error", (frames,), np.float32, "m"),
        )

    def store(
        self, smpl: SMPL, window: Window, betas: Tensor, pose: Tensor, trans: Tensor, mesh: Tensor
    ) -> None:
        """Write offsets and errors of n frames with their fitted betas (10,) and poses.

        `pose` (n, 22, 3) is in radians, `trans` (n, 3) and `mesh` (n, V, 3) in metres. DsnetError
        if the mean distance of a frame from the fitted body is too large for soft tissue.
        """
        offsets, distances = rest_pose_offsets(smpl, mesh, betas.expand(len(mesh), -1), pose, trans)
        frame_error = distances.mean(1)
        if not (frame_error < _WORST_MEAN_M).all():
            # NaN counts as the worst.
            worst = int(frame_error.nan_to_num(torch.inf, torch.inf).argmax())
            raise DsnetError(
                f"{window.sequence.name}, whose frame {window.start + worst} stays"
                f" {100 * frame_error[worst]:.0f} cm from SMPL",
                "meshes with SMPL's vertex order",
                "Register the meshes to SMPL's template, pass more --steps, or"
                f" --leave-out {window.sequence.name}.",
            )
        self.offsets.write(window.rows.start, offsets.numpy())
        self.frame_error.write(window.rows.start, frame_error.numpy())

    def warnings(self, sequence: MotionSequence, meshes: Meshes, close_m: float) -> Iterator[str]:
        """Warnings about an aligned sequence, one line each."""
        name, rows = sequence.name, sequence.frames
        pose, trans_m = unpack_theta(self.theta.read(rows).astype(np.float64))
        if (fall_g := steepest_fall_g(trans_m[:, 1], sequence.fps)) > MOST_FALL_G:
            yield (
                f"{name} falls with {fall_g:.1f} times gravity at {sequence.fps:g} frames a second:"
                " its meshes have another rate, or repeat where scans failed"
            )
        sample = meshes.read(0, sequence.length, _EVERY_VERTEX)
        if (repeated := repeated_frames(sample, sequence.fps)).any():
            yield (
                f"{name} repeats {repeated.sum()} of its {len(repeated)} meshes while the body"
                f" moves, first number {repeated.argmax()}: cut it there"
            )
        if is_head_down(pose):
            yield f"{name} is head down for most of it: y of its meshes may point down"
        if (off_m := self.frame_error.read(rows).mean()) > close_m:
            yield (
                f"{name} stays {100 * off_m:.0f} cm from SMPL: more than one person may be named"
                f" {sequence.subject}"
            )

    def digest(self, group: Iterable[Window]) -> str:
        """Digest of the present contents of these windows."""
        files = vars(self).items()
        windows = ({name: file.read(window.rows) for name, file in files} for window in group)
        return json_sha256([arrays_sha256(arrays) for arrays in windows])


class CorpusFit(ABC):
    """Alignment of a corpus by one method; `write` fills the artifact."""

    close_m = np.inf
    """Mean distance of a sequence from SMPL, metres, above which there is a warning."""

    def __init__(
        self, smpl: SMPL, sequences: Sequence[MotionSequence], meshes: Mapping[str, Meshes]
    ) -> None:
        self.smpl, self.sequences, self.meshes = smpl, sequences, meshes

    @abstractmethod
    def learn(self) -> dict[str, NDArray]:
        """`betas` (S, 10), and other arrays that `fit` needs."""

    @abstractmethod
    def groups(self) -> list[list[Window]]:
        """All windows, in the groups and the order in which they are fitted."""

    @abstractmethod
    def fit(
        self,
        learned: Mapping[str, NDArray],
        groups: Sequence[Sequence[Window]],
        files: AlignedFiles,
    ) -> Generator[NDArray[np.float32], None, None]:
        """theta (n, 69) of each window, in order.

        Workers write the other arrays to the files. When the next theta is requested, all previous
        ones are already in the files.
        """

    def write(self, writer: ArtifactWriter) -> None:
        """Write all arrays; work that an earlier process has finished is not repeated."""
        checkpoint = writer.checkpoints / "subjects.safetensors"
        if (learned := load_checkpoint(checkpoint)) is None:
            learned = self.learn()
            save_checkpoint(checkpoint, learned)
        frames = sum(sequence.length for sequence in self.sequences)
        files = AlignedFiles.of(writer, frames, self.smpl.vertex_count)
        marks = {writer.checkpoints / f"{i}.done": g for i, g in enumerate(self.groups())}
        left = {m: g for m, g in marks.items() if not is_written(m, partial(files.digest, g))}
        done = frames - sum(w.stop - w.start for group in left.values() for w in group)
        with (
            tqdm(total=frames, initial=done, desc="align", unit="frame", disable=None) as bar,
            closing(self.fit(learned, list(left.values()), files)) as thetas,
        ):
            for mark, group in left.items():
                for window, theta in zip(group, thetas, strict=False):
                    files.theta.write(window.rows.start, theta)
                    bar.update(len(theta))
                mark_written(mark, files.digest(group))
        for sequence in self.sequences:
            for warning in files.warnings(sequence, self.meshes[sequence.name], self.close_m):
                notify(warning)
        writer.put("betas", learned["betas"], "1")
        writer.record(sequences=to_manifest(self.sequences))
