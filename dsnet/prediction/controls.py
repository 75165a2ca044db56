"""The options of a moving body: those of every command that moves one.

A command's configuration inherits `Controls`, and `controlled_body` makes of them what prediction,
export and the viewer iterate over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import GENDERS, SMPL_JOINT_NAMES
from bridge.body.posing import shaped_joints, shaped_vertices
from bridge.errors import DsnetError, notify, unknown_name
from bridge.motion import Motion, load_motion
from bridge.motion.motion import HowRead
from bridge.motion.skeletons import read_joint_map
from bridge.options import check_options
from bridge.paper import FPS, N_BETAS
from dsnet.markers.bone_pose import bone_pose_of
from dsnet.prediction.gains import GAINS, gains_of_parts
from dsnet.prediction.load_model import Source, TrainedModel, is_on, load_model, requested_body
from dsnet.prediction.loops import REMEDY, Loop, close_loop
from dsnet.prediction.motion_options import MotionOptions
from dsnet.prediction.moving_body import SOLE_PERCENTILE, MovingBody, lowest_points_m, place_motion
from dsnet.prediction.shape_space import UseOfBetas, use_of_betas, with_betas_on
from dsnet.prediction.shapes import find_shape, parse_shape

Floor = Literal["keep", "shift", "scale"]
_LEGS = ("left_hip", "right_hip")


@dataclass(frozen=True, kw_only=True)
class Controls(MotionOptions):
    """How a body moves; what is left at its default changes nothing."""

    gain: Annotated[float, GAINS] = 1.0
    """Multiplies the soft-tissue dynamics, as far as flesh strains: 0 is SMPL alone, 1 the
    prediction, 20 the most."""
    part_gain: tuple[str, ...] = ()
    """Gains of body parts, multiplied by --gain: `belly=2 chest=0.5`. Parts are head, chest, belly,
    back, buttocks, upper_arms, forearms, hands, thighs, calves, feet; groups are torso, arms, legs.
    """
    floor: Floor = "keep"
    """`keep`: heights as in the file; `shift`: the whole motion is moved up or down until the feet
    stand on the floor; `scale`: strides are also scaled to the length of the body's legs."""
    loop: bool = False
    """Loop the motion: body and skin of the last frame lead into the first."""
    shape: tuple[str, ...] = ()
    """Body shape in place of the motion file's: names (tall, short, heavy, slim, pear, apple),
    measurements in cm and kg (height=182 weight=80 chest=100 waist=90 hips=105), or both."""
    betas: str | None = None
    """Body shape in place of the motion file's: ten shape coefficients, separated by commas."""

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Controls:
        """Controls from their fields by name.

        `part_gain` and `shape` may be one text, a list of words or a dictionary of numbers by name,
        `betas` any sequence of numbers.
        """
        names = [field.name for field in fields(Controls)]
        for name in given:
            if name not in names:
                raise unknown_name(f"{name}=", name, names, "Pass fields of dsnet.Controls.")
        made: dict[str, Any] = dict(given)
        for name in {"part_gain", "shape"} & {*made}:
            made[name] = _words_of(name, made[name])
        if not isinstance(made.get("betas"), (str, NoneType)):
            made["betas"] = ",".join(map(str, np.ravel(made["betas"]).tolist()))
        for name in ("body", "joint_map"):
            if made.get(name) is not None:
                made[name] = Path(made[name])
        return cls(**made)

    def check(self) -> None:
        """Refuse what needs no body to be refused."""
        check_options(self)
        if self.part_gain:
            gains_of_parts(self.part_gain)
        if self.betas is not None and self.shape:
            raise DsnetError(
                "--betas with --shape", "one way to say a shape", "Leave one of them out."
            )
        if self.betas is not None:
            _parsed_betas(self.betas)
        if self.shape:
            if not self._words():
                raise DsnetError("an empty --shape", "names or measurements", "Pass --shape tall.")
            parse_shape(self._words())

    def _words(self) -> list[str]:
        """The shape's, one by one."""
        return [word for text in self.shape for word in text.replace(",", " ").split()]

    def given(self) -> dict[str, Any]:
        """Those that are not left at their default, by name; the body is recorded beside them."""
        defaults = {field.name: field.default for field in fields(Controls) if field.name != "body"}
        given = {n: getattr(self, n) for n in defaults if getattr(self, n) != defaults[n]}
        return {n: str(value) if isinstance(value, Path) else value for n, value in given.items()}

    def load(
        self,
        source: Source,
        predictor: str | None,
        path: Path,
        load: Callable[..., TrainedModel] = load_model,
    ) -> tuple[TrainedModel, Motion]:
        """A predictor on the requested body, and the motion of a file as it has it.

        A run that cannot predict is refused before the file is read. Who has many motions passes a
        `load` that remembers.
        """
        trained = None
        if source is not None and not requested_body(self.body):
            trained = self.model(source, predictor, load=load)
        how = self.how_read()
        motion = load_motion(path, self.motion_fps, smooth_hz=self.smooth_hz, how=how)
        return trained or self.model(source, predictor, motion, load), motion

    def model(
        self,
        source: Source,
        predictor: str | None,
        motion: Motion | None = None,
        load: Callable[..., TrainedModel] = load_model,
    ) -> TrainedModel:
        """A predictor on the requested body, else on one that suits a motion; the package's
        where no source is given. DsnetError if the body is of another gender than requested.
        """
        gender, kind, more_betas = "unknown", None, 0
        if motion is not None:
            gender, kind, more_betas = motion.gender, motion.kind, len(motion.more_betas)
        body = requested_body(self.body)
        trained = load(source, predictor, self.gender or gender, body, kind, more_betas)
        self.check_model(trained)
        return trained

    def check_model(self, trained: TrainedModel) -> None:
        """Refuse a predictor on another body than requested."""
        if self.body is not None and not is_on(trained.body_model, self.body):
            raise DsnetError(
                f"body={str(self.body)!r} with {trained.name} on {trained.body_model}",
                "a predictor on that body",
                "Load both by Controls.load, or load_model(run, body=...).",
            )
        if self.gender and self.gender != trained.body.gender and trained.body.gender in GENDERS:
            raise DsnetError(
                f"--gender {self.gender} with {trained.body.name} for {trained.name} of "
                f"{trained.owner}",
                f"a {trained.body.gender} body's",
                "Leave --gender out, or pass another --body, or a --run that was trained on one.",
            )

    def how_read(self) -> HowRead:
        """What they say of the motion file."""
        names = {} if self.joint_map is None else read_joint_map(self.joint_map)
        return HowRead(self.up, names, person=self.person)

    def requested_betas(self, body: BodyModelData) -> NDArray[np.float64] | None:
        """(S,) betas of the requested shape; None where the motion's is meant."""
        if self.betas is not None:
            given, count = _parsed_betas(self.betas), body.shapedirs.shape[-1]
            return np.pad(given[:count], (0, max(0, count - N_BETAS)))
        if not self.shape:
            return None
        return find_shape(body, self._words())

    def use_of_betas(self, motion: Motion, body: BodyModelData) -> UseOfBetas:
        """What becomes of the betas of a motion as its file has it."""
        found, asked = use_of_betas(motion, body), self.betas is not None or self.shape
        return "not used" if asked and found == "used" else found


def _words_of(name: str, given: Any) -> tuple[str, ...]:
    if isinstance(given, str):
        return (given,)
    if isinstance(given, Mapping):
        return tuple(f"{part}={number}" for part, number in given.items())
    if not isinstance(given, Sequence):
        raise DsnetError(f"{name}={given!r}", "words or numbers by name", "Pass {'height': 182}.")
    return tuple(map(str, given))


def controlled_body(trained: TrainedModel, motion: Motion, controls: Controls) -> MovingBody:
    """A body that performs a motion by an animator's options.

    Parameters
    ----------
    motion : as its file has it, read with `motion_fps` and `smooth_hz` if the controls have them.

    Raises
    ------
    DsnetError
        If a requested thing does not exist, is out of reach or does not go together, or the
        motion is not one of a body of a person's size.
    """
    controls.check()
    requested = controls.motion_fps, controls.smooth_hz
    for name, wanted, read in zip(
        ("motion_fps", "smooth_hz"), requested, (motion.source_fps, motion.smooth_hz), strict=True
    ):
        if wanted not in (None, read):
            raise DsnetError(
                f"{motion.source}, read with {name}={read}",
                f"it with {wanted}, as the controls say",
                f"Read it by load_motion(path, {name}={wanted!r}).",
            )
    if motion.fps != FPS:
        raise DsnetError(
            f"{motion.source} at {motion.fps:g} frames a second",
            f"the {FPS:g} at which skin is predicted",
            "Load it without fps=, and take frames of the result.",
        )
    controls.check_model(trained)
    body, gain = trained.body, controls.gain
    betas, shaped = controls.requested_betas(body), motion.betas.any()
    motion = with_betas_on(motion, body, warn=betas is None)
    if controls.floor == "scale" and shaped and not motion.betas.any():
        notify(
            f"--floor scale: the betas of {motion.source} do not say whose legs walked, mean ones "
            "are taken; --floor shift scales nothing"
        )
    if controls.pose == "bony":
        motion = bone_pose_of(body, motion)
    if controls.part_gain:
        gain = gain * gains_of_parts(controls.part_gain)
    placed = place_motion(motion, body, betas)
    placed, loop = put_on_floor(placed, body, controls.floor, motion.betas), None
    if controls.loop:
        placed, loop = _looped(placed, body)
    return MovingBody(trained, placed, gain, controls.given(), loop)


def _looped(placed: Motion, body: BodyModelData) -> tuple[Motion, Loop]:
    """A motion that stands where it shall as one that repeats."""
    if placed.cuts:
        jumps = f"--loop with {placed.source}, which jumps at frame {placed.cuts[0]}"
        raise DsnetError(jumps, "a motion without cuts", REMEDY)
    closed = close_loop(placed.theta, root_joint_m(body, placed.betas))
    if closed.dropped:
        notify(f"the last frame of {placed.source} is its first again: left out of the loop")
    cycle = placed.frames(slice(len(closed.theta)))  # the hands' too
    return replace(cycle, theta=closed.theta), closed


def _parsed_betas(text: str) -> NDArray[np.float64]:
    try:
        betas = np.array([float(part) for part in text.split(",")])
    except ValueError:
        betas = np.empty(0)
    if betas.shape != (N_BETAS,) or not np.isfinite(betas).all():
        raise DsnetError(
            f"--betas {text}",
            f"{N_BETAS} finite numbers",
            "Separate them by commas, no spaces.",
        )
    return betas


def put_on_floor(motion: Motion, body: BodyModelData, floor: Floor, file_betas: NDArray) -> Motion:
    """A motion whose lowest point stands on the floor, at height 0.

    Parameters
    ----------
    motion : y up, about the root joint of the body that performs it.
    floor : `keep` changes nothing; `shift` adds one number to all heights, so that jumps take the
        time they take; `scale` first multiplies the root's travel and height by the ratio of leg
        lengths, so that strides fit.
    file_betas : (10,) shape of the person whose motion it is.
    """
    if floor == "keep":
        return motion
    if floor == "scale":
        motion = _strides_fitted(motion, body, file_betas)
    low_m = np.percentile(lowest_points_m(motion, body), SOLE_PERCENTILE)
    return motion.moved(motion.trans_m - [0.0, low_m, 0.0])


def leg_length_m(body: BodyModelData, betas: NDArray) -> float:
    """From the hips' joints to the soles, of a body of shape betas (10,) at rest."""
    betas = np.asarray(betas, np.float64)[None]
    hips = shaped_joints(body, betas)[0, [SMPL_JOINT_NAMES.index(name) for name in _LEGS], 1]
    return float(hips.mean() - shaped_vertices(body, betas)[0, :, 1].min())


def _strides_fitted(motion: Motion, body: BodyModelData, file_betas: NDArray) -> Motion:
    file_leg_m = leg_length_m(body, file_betas)
    if not 0.1 < file_leg_m < 10.0:
        legs = f"--floor scale with {motion.source}, whose betas are of legs of {file_leg_m:.3g} m"
        raise DsnetError(legs, "a person's", "Pass --floor shift.")
    joint_m = root_joint_m(body, motion.betas)
    places_m = motion.trans_m + joint_m
    start_m = places_m[:1] * [1.0, 0.0, 1.0]
    places_m = start_m + leg_length_m(body, motion.betas) / file_leg_m * (places_m - start_m)
    return motion.moved(places_m - joint_m)


def root_joint_m(body: BodyModelData, betas: NDArray) -> NDArray[np.float64]:
    """(3,) where the root joint of a body of shape betas (10,) rests."""
    return shaped_joints(body, np.asarray(betas, np.float64)[None])[0, 0]
