"""Motions as synthetic people perform them, and the AMASS files of those that are held out."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import shaped_joints
from bridge.motion.resampling import load_amass_motion, load_motion_file
from torch_align_ae.corpus.amass_files import write_amass_motion
from torch_align_ae.corpus.dyna_files import FPS
from torch_align_ae.corpus.motions import Skeleton, perform
from torch_align_ae.corpus.motions.plan import Array
from torch_align_ae.corpus.sequences import MOSH_FPS, Take
from torch_align_ae.corpus.subjects import Gender, Subject


@dataclass(frozen=True, eq=False)
class Performer:
    """Moves the bodies of one gender; `seed` is that of everybody's style."""

    data: BodyModelData
    gender: Gender
    seed: int

    def for_meshes(self, take: Take) -> NDArray[np.float32]:
        """theta (T, 69) at 60 fps as it is stored: what the simulation follows is what is read."""
        return self._procedural(take, FPS).astype(np.float32)

    def as_read_back(self, take: Take) -> NDArray[np.float32]:
        """theta (T, 69) of a held-out take as every reader of its file sees it: 60 fps, y up."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "motion.npz"
            self.write_amass(path, take)
            joint_m = self._root_joint_m(take.subject)
            motion = load_amass_motion(path, root_joint_m=joint_m, fps=FPS)
        return motion.theta.astype(np.float32)

    def write_amass(self, path: Path, take: Take) -> None:
        """Write a held-out take: 100 fps as MoSh's, or the rate of the real motion."""
        if take.source is None or take.source_fps is None:
            fps, source = MOSH_FPS, "synthetic"
            theta = self._procedural(take, fps).astype(np.float32).astype(np.float64)
        else:
            fps = take.source_fps
            source = f"synthetic body, motion of {take.source.name}"
            theta = self._real(take, take.source, fps)
        write_amass_motion(
            path,
            theta,
            betas=take.subject.betas,
            gender=self.gender,
            fps=fps,
            root_joint_m=self._root_joint_m(take.subject),
            source=source,
        )

    def _procedural(self, take: Take, fps: float) -> Array:
        return perform(
            take.kind,
            take.subject.name,
            Skeleton.of(self.data, take.subject.betas),
            frame_count=take.frame_count,
            fps=fps,
            seed=self.seed,
            take=take.number,
        )

    def _real(self, take: Take, source: Path, fps: float) -> NDArray[np.float64]:
        """The real motion about this person's root joint; only its motion is used, no shape."""
        joint_m = self._root_joint_m(take.subject)
        motion = load_motion_file(source, fps, fps, take.smooth_hz).about_root_joint(joint_m)
        return np.asarray(motion.theta[: take.frame_count], np.float64)

    def _root_joint_m(self, subject: Subject) -> NDArray[np.float64]:
        return shaped_joints(self.data, subject.betas[None])[0, 0]
