"""A body in motion: skin offsets and posed vertices, some frames at a time.

What prediction, export and the viewer have in common; memory does not grow with the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import Smpl, full_pose
from bridge.body.skin import skin_png
from bridge.errors import DsnetError, notify
from bridge.motion import Motion, unpack_theta
from bridge.motion.motion import FARTHEST_M
from bridge.motion.motion_checks import motion_warnings
from bridge.paper import N_JOINTS
from bridge.runs.workers import progress
from dsnet.markers.bone_pose import flesh_in_pose
from dsnet.prediction.gains import Gains
from dsnet.prediction.load_model import NO_RUN, TrainedModel
from dsnet.prediction.loops import Loop
from dsnet.prediction.models import Prediction, decoded, predict_loop, predict_whole
from dsnet.prediction.runtimes import RUNTIME_NAMES
from dsnet.prediction.shape_space import pelvis_apart_m

SOLE_PERCENTILE = 1.0
"""Of the lowest points of all frames: a single bad frame does not lift the motion."""
_FEET = ("left_ankle", "right_ankle", "left_foot", "right_foot")
_EVERY = 8
"""Vertices of the rest of the body, of which fewer are looked at than of the feet."""
_WARN_FLOOR_M, _FLOOR_FRAMES = 0.03, 120
LARGEST_BODY_M = 10.0
"""A shape larger than this is no person's."""


@dataclass(frozen=True, eq=False)
class MovedFrames:
    """T' frames that follow one another."""

    frames: slice
    """Which of the motion's."""
    offsets_m: NDArray[np.float32]
    """(T', V, 3) in the rest pose, metres."""
    predicted_m: NDArray[np.float32]
    """The same before any gain."""
    gains: NDArray[np.float32] | None
    """(T', 11) of the body's parts, where strain limits them."""
    posed: Callable[[MovedFrames], NDArray[np.float32]]

    def __len__(self) -> int:
        return len(self.offsets_m)

    @cached_property
    def vertices_m(self) -> NDArray[np.float32]:
        """(T', V, 3) in the world, metres, y up; posed when they are first read."""
        return self.posed(self)


class MovingBody:
    """A body that performs a motion; iterating gives `MovedFrames` from first to last.

    It begins from rest, settled in its first pose, there and after every cut.

    Parameters
    ----------
    trained : what moves it.
    motion : (T, 69) at 60 frames a second with y up, and the shape to move with.
    gain : by which the predicted offsets are multiplied, as far as flesh strains
        (`dsnet.prediction.gains`), one number or one a part of the body (11,): 0 is SMPL alone, 1
        what was predicted.
    controls : an animator's options, by name: `Controls.given()`, which motion, gain and
        loop already obey. It goes with what is written of the body.
    loop : the motion as one that repeats, if it does.
    """

    def __init__(
        self,
        trained: TrainedModel,
        motion: Motion,
        gain: float | NDArray[np.floating] = 1.0,
        controls: Mapping[str, Any] | None = None,
        loop: Loop | None = None,
    ) -> None:
        self.trained, self.motion = trained, motion
        self.controls = dict(controls or {})
        self.pieces = motion.pieces
        self.loop = loop
        self.gains = Gains(trained.body, gain)
        self.plain = False
        """Whether it is shown without the picture of skin that an embedded body has."""

    def __len__(self) -> int:
        return len(self.motion.theta)

    def __repr__(self) -> str:
        return f"<{self.body.name} performs {self.motion!r}, moved by {self.trained.name}>"

    @property
    def body(self) -> BodyModelData:
        return self.trained.body

    @property
    def skin_png(self) -> bytes | None:
        """The picture of skin that the body is shown with, a PNG file, if there is one."""
        return None if self.plain else skin_png(self.body)

    @property
    def pose(self) -> NDArray[np.floating]:
        """(T, 22, 3) joint rotations, axis-angle, or all that the body has where others move."""
        return pose_on(self.motion, self.body)

    @property
    def latents(self) -> NDArray[np.float32] | None:
        """(T, 100) codes that the offsets are decoded from, before any gain, if there are any."""
        latents = self._latents_of_pieces
        return None if latents is None else np.concatenate(latents)

    @cached_property
    def _latents_of_pieces(self) -> list[NDArray[np.float32]] | None:
        """Of each piece between cuts: the network computes them once."""
        if not self.trained.model.codes_are_latents:
            return None
        return [each.latents for each in self._predictions() if each.latents is not None]

    def _offset_pieces(self) -> Iterator[NDArray[np.float32]]:
        """Of all frames, some at a time."""
        if self._latents_of_pieces is None:
            return chain.from_iterable(each.offsets_m for each in self._predictions())
        model, theta, betas = self.trained.model, self.motion.theta, self.motion.betas
        latents = zip(self._latents_of_pieces, self.pieces, strict=True)
        pieces = (decoded(model, codes, theta[piece], betas) for codes, piece in latents)
        return chain.from_iterable(pieces)

    def _predictions(self) -> list[Prediction]:
        """Of each piece between cuts; their offsets are computed when they are iterated."""
        theta, betas = self.motion.theta, self.motion.betas
        predict = partial(predict_whole, self.trained.model)
        if self.loop is not None:
            return [predict_loop(predict, self.loop, betas)]
        return [predict(theta[piece], betas) for piece in self.pieces]

    def __iter__(self) -> Iterator[MovedFrames]:
        pose, trans = self.pose, self.motion.trans_m
        smpl = Smpl(self.body, hands=pose.shape[1] > N_JOINTS)
        shaped, start = smpl.person(self.motion.betas), 0

        def finite(values_m: NDArray[np.float32], frames: slice) -> NDArray[np.float32]:
            if np.isfinite(values_m).all():
                return values_m
            raise DsnetError(
                f"{self.motion.source}, whose skin is not finite from frame {frames.start} on",
                "a predictor that gives finite offsets",
                "Train the run again, or pass another --run.",
            )

        def posed(moved: MovedFrames) -> NDArray[np.float32]:
            frames = moved.frames
            return finite(shaped.pose(pose[frames], trans[frames], moved.offsets_m), frames)

        for offsets_m in self._offset_pieces():
            frames, gains = slice(start, start + len(offsets_m)), None
            gain = self.gains.unlimited
            if self.gains.limited:
                gains = self.gains.left_of_parts(offsets_m)
                gain = (gains @ self.gains.shares.T)[..., None]
            yield MovedFrames(frames, finite(offsets_m * gain, frames), offsets_m, gains, posed)
            start = frames.stop

    def arrays(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Vertices (T, V, 3) in the world and offsets (T, V, 3) in the rest pose, metres, of all
        frames: 165 MB a thousand frames of an SMPL body."""
        pieces = [(moved.vertices_m, moved.offsets_m) for moved in self]
        vertices_m, offsets_m = zip(*pieces, strict=True)
        return np.concatenate(vertices_m), np.concatenate(offsets_m)

    def shown(self, what: str) -> Iterator[MovedFrames]:
        """The same frames; a terminal shows how far `what` is."""
        with progress(what=what, unit="frame", total=len(self)) as bar:
            for posed in self:
                yield posed
                bar.update(len(posed))

    def announce(self) -> None:
        """Say on stderr which predictor moves the body, with warnings about the motion."""
        by, why = self.trained, self.trained.why
        if why == NO_RUN and self.motion.gender == "unknown" and "gender" not in self.controls:
            why += ", and the motion names no gender: --gender male for a man"
        how = RUNTIME_NAMES[by.runtime]
        notify(f"{by.name} ({by.label}) of {by.owner} predicts with {how}: {why}")
        for warning in self.warnings():
            notify(warning)

    def warnings(self) -> list[str]:
        """About the motion, a line each."""
        lines = motion_warnings(self.motion)
        lines += [] if "pose" in self.controls else flesh_in_pose(self.motion)
        if "floor" in self.controls:
            return lines
        sampled = self.motion.frames(slice(None, None, max(1, len(self) // _FLOOR_FRAMES)))
        lowest_m = lowest_points_m(sampled, self.body)
        if abs(low_m := np.percentile(lowest_m, SOLE_PERCENTILE)) > _WARN_FLOOR_M:
            how = "floats above" if low_m > 0 else "sinks into"
            lines.append(
                f"{self.motion.source} {how} the floor by {100 * abs(low_m):.0f} cm at its lowest: "
                "--floor shift puts it there"
            )
        return lines


def pose_on(motion: Motion, body: BodyModelData) -> NDArray[np.floating]:
    """(T, 22, 3) joint rotations, axis-angle, or all that the body has where others move."""
    if motion.hands_and_face is None or body.kind == "smpl":
        return motion.pose
    return full_pose(motion.pose, motion.hands_and_face, len(body.parents))


def place_motion(
    motion: Motion, body: BodyModelData, betas: NDArray[np.float64] | None = None
) -> Motion:
    """A motion as its file has it, turned to y up about the root joint of the body that will be
    posed, with the shape betas (S,) in place of the file's; the pelvis is where the file's kind of
    body has it. DsnetError if it is not one of a body of a person's size.
    """
    if betas is not None:
        motion = replace(motion, betas=betas)
    apart_m = pelvis_apart_m(motion, body)
    placed = motion.about_root_joint(persons_root_joint_m(motion, body) + apart_m)
    return placed.moved(placed.trans_m + apart_m)


def persons_root_joint_m(motion: Motion, body: BodyModelData) -> NDArray[np.float64]:
    """(3,) of a body at rest, metres, of the motion's betas (S,). DsnetError if the motion is not
    one of a body of a person's size."""
    with np.errstate(over="ignore", invalid="ignore"):
        rest = body.v_template + body.shapedirs @ motion.betas
        size_m, far_m = np.ptp(rest, axis=0).max(), np.abs(motion.trans_m).max()
    if not (size_m < LARGEST_BODY_M and far_m < FARTHEST_M):
        raise DsnetError(
            f"{motion.source}, a body of {size_m:.3g} m that moves {far_m:.3g} m off",
            f"a person within {FARTHEST_M:g} m of the origin",
            "Check the file's betas and trans; --betas gives another shape.",
        )
    return (body.J_regressor @ rest)[0]


def lowest_points_m(motion: Motion, body: BodyModelData) -> NDArray[np.float64]:
    """(T,) height of the body's lowest point in each frame, without skin offsets."""
    feet = body.weights[:, [SMPL_JOINT_NAMES.index(name) for name in _FEET]].sum(axis=1) > 0.5
    looked_at = feet | (np.arange(len(feet)) % _EVERY == 0)
    person = Smpl(body, np.flatnonzero(looked_at), np.float64).person(motion.betas)
    places_m = person.pose(*unpack_theta(np.asarray(motion.theta, np.float64)))
    return places_m[..., 1].min(axis=1)
