"""A motion that a body can follow: what a file says of it, and where it has cuts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bridge.motion.cuts import find_cuts
from bridge.motion.markers import MarkerFile
from bridge.motion.theta import pack_theta, unpack_theta
from bridge.paper import N_JOINTS

UpAxis = Literal["y", "z"]
Up: TypeAlias = Literal["auto", "y", "z"]
SmoothHz: TypeAlias = float | Literal["auto"]
"""A cutoff in Hz, or what suits each moment."""
Y_UP_FROM_Z_UP = Rotation.from_euler("x", -90, degrees=True)

# What no person's motion or shape exceeds, whatever body model it is for.
FARTHEST_M = 1000.0
"""A place farther off is no motion's."""
HIGHEST_M = 50.0
"""Above or below the floor, over most of a motion: who is there is in another unit."""
RATES_HZ = 1.0, 10_000.0
"""Of a file. Motion capture runs at 30 to 480 frames a second; a slower "rate" is a duration or a
slip."""
LARGEST_ANGLE_RAD = 100.0
"""Of a joint: sixteen turns. A dancer's spin is often written as an angle that goes on growing."""
LARGEST_BETA = 100.0
"""In standard deviations of people's shapes."""
MOST_FRAMES = 108_000
"""Of a file, and of what is made of it: a quarter of an hour at 120 Hz, half an hour at 60."""


@dataclass(frozen=True)
class HowRead:
    """What a user says of a file that it does not say itself, or says wrong."""

    up: Up = "auto"
    """Its vertical axis."""
    joint_map: Mapping[str, str] = field(default_factory=dict)
    """The file's joints by SMPL's names, where names do not say."""
    fps: float | None = None
    """Its frames a second; `load_motion` sets it from its `source_fps`."""
    person: int | None = None
    """Whose motion of several people's: 1 is the first."""


AS_IT_SAYS = HowRead()


def amass_poses(
    all_joints: NDArray[np.floating], trans_m: NDArray[np.floating], root_joint_m: NDArray
) -> tuple[NDArray[np.floating], NDArray[np.float64]]:
    """AMASS's poses (T, 3 J) and translation (T, 3), z up, of rotations (T, J, 3) with y up.

    The root turns about its joint J0, which lies at J0 + trans: turning the world turns that sum.
    """
    turn, poses = Y_UP_FROM_Z_UP.inv(), all_joints.copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    return poses.reshape(len(poses), -1), turn.apply(trans_m + root_joint_m) - root_joint_m


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """A motion that a 22-joint body can follow: as a file has it, z up at its rate, or prepared."""

    theta: NDArray[np.floating]
    """(T, 69) pose vector of the paper: 22 x 3 axis-angle, radians, and translation, metres."""
    betas: NDArray[np.float64]
    """(10,) first shape coefficients, zero where the file has none: of bodies of this `kind` and
    `gender` alone."""
    gender: str
    """`female`, `male`, `neutral`, or `unknown` where the file does not say."""
    fps: float
    source_fps: float
    """Frames per second of the file; nan of one that does not say, before it is prepared."""
    source: Path
    kind: str | None = None
    """`smpl`, `smplh` or `smplx`: of whose body pose and betas are, where the file says."""
    more_betas: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(K,) the file's coefficients after the tenth, of which only bodies with more shapes make
    use."""
    hands_and_face: NDArray[np.floating] | None = None
    """(T, J - 22, 3) axis-angle, radians, of SMPL-H's fingers (30, the left hand's first) or of
    SMPL-X's jaw, left eye, right eye and fingers (33), where the file moves any; `full_pose` of
    `bridge.body.posing` puts them on a body. Zero is a flat hand."""
    up: UpAxis = "y"
    """Vertical axis of `theta`'s root."""
    dmpls: NDArray[np.float64] | None = None
    """(T, 8) DMPL soft tissue coefficients, where the file has them."""
    rest_pose_frames: int = 0
    """Frames of the file that come before the motion, a rest pose, and are left out."""
    smooth_hz: SmoothHz | None = None
    """What was faster in the file is left out; `auto`: than what suits each moment."""
    trans_of: Literal["z", "y", "joint"] = "z"
    """What the file's translation is: SMPL's, where the world has z or y up, or the place of the
    root joint itself."""
    embedded_betas: bool = False
    """Whether the file says that its betas are an embedded body's, as those of this project do."""
    notes: tuple[str, ...] = ()
    """Notes about the file, a line each."""
    world_turn: NDArray[np.float64] | None = None
    """(3, 3) what has turned the file's world upright, where that was neither y nor z up."""
    frame_numbers: NDArray[np.intp] | None = None
    """(T,) which frame of the recording each is, growing, where some are missing; `load_motion`
    fills them in."""
    markers: MarkerFile | None = None
    """Those that the pose was fitted to, of the whole file, where there are any."""
    cuts: tuple[int, ...] = ()
    """The first frame after each cut (`bridge.motion.cuts`). They are found when a motion is made,
    or `replace` gives it another theta."""
    cuts_of: NDArray[np.floating] | None = None
    """The theta whose cuts these are."""

    def __post_init__(self) -> None:
        if self.cuts_of is not self.theta:
            object.__setattr__(self, "cuts", find_cuts(self.theta))
            object.__setattr__(self, "cuts_of", self.theta)

    def __repr__(self) -> str:
        return (
            f"<Motion {self.source}: {len(self.theta)} frames at {self.fps:g} fps, {self.gender}>"
        )

    @property
    def pieces(self) -> list[slice]:
        """The frames between cuts: slices that follow one another."""
        return [slice(*ends) for ends in pairwise([0, *self.cuts, len(self.theta)])]

    @property
    def pose(self) -> NDArray[np.floating]:
        """(T, 22, 3) joint rotations, axis-angle, radians."""
        return unpack_theta(self.theta)[0]

    @property
    def all_joints(self) -> NDArray[np.floating]:
        """(T, 22, 3) joint rotations, or (T, J, 3) where hands and face move."""
        rest = [] if self.hands_and_face is None else [self.hands_and_face]
        return np.concatenate([self.pose, *rest], axis=1)

    def posed(self, all_joints: NDArray[np.floating], trans_m: ArrayLike, **changes: Any) -> Motion:
        """The motion with other rotations (T, 22 or J, 3) and translations (T, 3), metres; its
        cuts stay where they are."""
        rest = all_joints[:, N_JOINTS:] if self.hands_and_face is not None else None
        theta = pack_theta(all_joints, trans_m)
        return replace(self, theta=theta, cuts_of=theta, hands_and_face=rest, **changes)

    def moved(self, trans_m: ArrayLike) -> Motion:
        """The same with other translations (T, 3), metres, alone."""
        theta = pack_theta(self.pose, trans_m)
        return replace(self, theta=theta, cuts_of=theta)

    def frames(self, chosen: slice | NDArray[np.intp]) -> Motion:
        """Some of its frames, in order of time."""
        rest, dmpls, theta = self.hands_and_face, self.dmpls, self.theta[chosen]
        numbers = self.frame_numbers
        begins = np.searchsorted(np.arange(len(self.theta))[chosen], self.cuts)
        return replace(
            self,
            theta=theta,
            cuts=tuple(sorted({*begins.tolist()} - {0, len(theta)})),
            cuts_of=theta,
            hands_and_face=None if rest is None else rest[chosen],
            dmpls=None if dmpls is None else dmpls[chosen],
            frame_numbers=None if numbers is None else numbers[chosen],
        )

    @property
    def trans_m(self) -> NDArray[np.floating]:
        """(T, 3) translation of the root."""
        return unpack_theta(self.theta)[1]

    @property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        return (len(self.theta) - 1) / self.fps

    def about_root_joint(self, root_joint_m: ArrayLike) -> Motion:
        """The motion for a body whose root joint rests at `root_joint_m` (3,) instead of 0.

        SMPL turns the root about its rest position J0, so the file's root joint is at
        J0 + trans, and turning the world turns that sum: trans' = R (J0 + trans) - J0. A motion
        that was read without J0 lacks the constant R J0 - J0; one that says where the root joint
        is, the constant -J0.
        """
        joint = np.asarray(root_joint_m, dtype=np.float64)
        if self.world_turn is not None:
            return self.moved(self.trans_m + self.world_turn @ joint - joint)
        if self.up == self.trans_of:
            return self
        shift = (Y_UP_FROM_Z_UP.apply(joint) if self.trans_of == "z" else 0) - joint
        return self.moved(self.trans_m + shift)
