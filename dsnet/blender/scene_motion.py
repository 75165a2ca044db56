"""An armature as a scene moves it, as a motion that a body can follow. Needs no Blender.

Its bones are nodes such as glTF and FBX have them: the same retargeting brings them to SMPL's
joints (`bridge.motion.readers.nodes`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion import Motion
from bridge.motion.motion import Y_UP_FROM_Z_UP, HowRead
from bridge.motion.readers.nodes import NodeTree, Person, find_person, followed, moving

_FEWEST_FRAMES = 2


@dataclass(frozen=True, eq=False)
class SceneArmature:
    """An armature of B bones and T frames of a scene, z up."""

    name: str
    bones: tuple[str, ...]
    """Parents first."""
    parents: tuple[int, ...]
    """Of each bone; -1 of those without."""
    rest: NDArray[np.float64]
    """(B, 4, 4) from each bone's frame to the world, at rest."""
    world: NDArray[np.float64]
    """(T, B, 4, 4) the same in each frame."""
    fps: float

    def tree(self) -> NodeTree:
        """Its bones as nodes below one root."""
        return NodeTree(
            path=Path(self.name),
            names=("scene", *self.bones),
            parents=(-1, *(parent + 1 for parent in self.parents)),
            joints=tuple(range(1, len(self.bones) + 1)),
            rest=_as_nodes(self.rest),
            is_bound=True,
            rest_is="the armature's",
        )

    def person(self, joint_map: Mapping[str, str]) -> Person:
        """Which bones are a person's joints; DsnetError if some are missing. `joint_map` is the
        user's, the bone's name by SMPL's."""
        return find_person(self.tree(), joint_map)

    def motion(self, joint_map: Mapping[str, str]) -> Motion:
        """As its joints move in the scene, at the scene's rate, for a body of the mean shape."""
        if len(self.world) < _FEWEST_FRAMES:
            raise DsnetError(
                f"a scene of {len(self.world)} frame",
                "a frame range with a motion",
                "Set Start and End in the timeline.",
            )
        tree, person = self.tree(), self.person(joint_map)
        of_joints = _as_nodes(self.world)[:, list(person.nodes)]
        skeleton = moving(tree, person, of_joints, self.fps, ())
        return followed(skeleton, person, HowRead(), "y")


def _as_nodes(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., B + 1, 4, 4), y up, of (..., B, 4, 4): the world's own frame first. SMPL's own rest
    pose is known where y is up, as in files (`bridge.motion.rest_poses`)."""
    upright = np.eye(4)
    upright[:3, :3] = Y_UP_FROM_Z_UP.as_matrix().round(12)
    root = np.broadcast_to(np.eye(4), (*matrices.shape[:-3], 1, 4, 4))
    return np.concatenate([root, upright @ matrices], axis=-3)
