"""Motions of the corpus's subjects, and the AMASS files of those that are held out."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import full_pose, shaped_joints
from bridge.motion import unpack_theta
from bridge.motion.motion import HowRead, amass_poses
from bridge.motion.resampling import load_motion
from bridge.paper import FPS
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.recordings import MOSH_FPS, Recording
from dsnet.synthetic.subjects import Subject

_AMASS_JOINTS = 52
_AMASS_BETA_COUNT = 16


@dataclass(frozen=True, eq=False)
class CorpusMotions:
    """Motions of subjects of one body model; `seed` is that of their styles."""

    data: BodyModelData
    seed: int

    def procedural(self, recording: Recording, fps: float = FPS) -> NDArray[np.float32]:
        """theta (T, 69), rounded as it is stored, so that the simulation uses the same numbers."""
        skeleton = Skeleton(self.data, recording.subject.betas)
        theta = perform(
            recording.kind,
            recording.subject.name,
            skeleton,
            frame_count=recording.frame_count,
            fps=fps,
            seed=self.seed,
            take=recording.number,
        )
        return theta.astype(np.float32)

    def as_read_back(self, recording: Recording) -> NDArray[np.float32]:
        """theta (T, 69) of a held-out recording as read from its file: 60 fps, y up."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "motion.npz"
            self.write_amass(path, recording)
            motion = load_motion(path, fps=FPS, how=HowRead(up="z"))
        motion = motion.about_root_joint(self._root_joint_m(recording.subject))
        return motion.theta.astype(np.float32)

    def write_amass(self, path: Path, recording: Recording) -> None:
        """Write a held-out recording: at 100 fps as MoSh's, or at the rate of a real motion.

        A real motion is placed about the root joint of this subject; its betas are not used.
        """
        fps, source = recording.source_fps or MOSH_FPS, recording.source
        joint_m = self._root_joint_m(recording.subject)
        if source is None:
            theta = self.procedural(recording, fps)
        else:
            motion = load_motion(source, fps, fps, recording.smooth_hz)
            theta = motion.about_root_joint(joint_m).theta[: recording.frame_count]
        write_amass_motion(
            path,
            np.asarray(theta, np.float64),
            betas=recording.subject.betas,
            gender=self.data.gender,
            fps=fps,
            root_joint_m=joint_m,
            source=f"synthetic body, motion of {source.name}" if source else "synthetic",
        )

    def _root_joint_m(self, subject: Subject) -> NDArray[np.float64]:
        return shaped_joints(self.data, subject.betas[None])[0, 0]


def write_amass_motion(
    path: Path,
    theta: NDArray[np.float64],
    *,
    betas: NDArray[np.float64],
    gender: str,
    fps: float,
    root_joint_m: NDArray[np.float64],
    source: str = "synthetic",
) -> None:
    """Write theta (T, 69), y up, as an AMASS `.npz`: SMPL-H parameters, z up, gender as bytes.

    `root_joint_m` (3,) is the subject's root joint in the rest pose, about which SMPL turns.
    """
    pose, trans = unpack_theta(theta)
    poses, trans_m = amass_poses(full_pose(pose, None, _AMASS_JOINTS), trans, root_joint_m)
    np.savez(
        path,
        poses=poses,
        trans=trans_m,
        betas=np.pad(betas, (0, _AMASS_BETA_COUNT - len(betas))),
        gender=np.array(gender.encode()),
        mocap_framerate=np.array(fps),
        dmpls=np.zeros((len(theta), 8)),
        source=np.array(source),
    )
