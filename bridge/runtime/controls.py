"""What an animator may ask of a moving body, as the options of every command that moves one.

A command's configuration inherits `Controls`, and `controlled_body` makes of them what prediction,
export and the viewer iterate over.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, fields, replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.shapes import find_shape, parse_shape
from bridge.errors import DsnetError, notify
from bridge.motion import Motion
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.loops import REMEDY, Lap, close_lap
from bridge.motion.smoothing import described
from bridge.options import PositiveFloat, check_options
from bridge.paper import N_BETAS
from bridge.runtime.body_motion import place_motion
from bridge.runtime.characters import Character
from bridge.runtime.floor import Floor, put_on_floor, root_joint_m
from bridge.runtime.looped import LoopedPredictor
from bridge.runtime.moving_body import MovingBody
from bridge.runtime.part_gains import GAINS, gains_of_parts, vertex_gain


@dataclass(frozen=True, kw_only=True)
class Controls:
    """How a body moves; what is left at its default changes nothing."""

    gain: Annotated[float, GAINS] = 1.0
    """Multiplies the skin's dynamics: 0 is SMPL alone, 1 what was predicted."""
    part_gain: tuple[str, ...] = ()
    """The same for parts of the body, on top of --gain, as in `belly=2 chest=0.5`: head, chest,
    belly, back, buttocks, upper_arms, forearms, hands, thighs, calves, feet; torso, arms, legs."""
    floor: Floor = "keep"
    """`shift` moves the whole motion up or down until the feet stand on the floor; `scale` also
    fits its strides to the body's legs; `keep` leaves heights as the file has them."""
    loop: bool = False
    """The motion repeats: the skin's last frame leads into its first."""
    shape: tuple[str, ...] = ()
    """Body shape in place of the motion file's, by name: tall, short, heavy, slim, pear, apple;
    by measurement, in cm and kg: height=182 weight=80 chest=100 waist=90 hips=105; or both."""
    betas: str | None = None
    """Body shape in place of the motion file's: ten comma-separated coefficients."""
    motion_fps: PositiveFloat | None = None
    """Frames per second of the motion file, where what it says of itself is wrong."""
    smooth_hz: PositiveFloat | Literal["auto"] | None = None
    """Leave out what is faster in the motion: the noise of a recording shakes the skin. `auto`
    finds the cutoff that suits each moment."""

    def check(self) -> None:
        """Refuse what needs no body to be refused.

        Raises
        ------
        DsnetError
            If something asked for does not exist, is no number or does not go together.
        """
        check_options(self)
        gains_of_parts(self.part_gain)
        if self.betas is not None and self.shape:
            raise DsnetError(
                "--betas with --shape", "one way to say a shape", "Leave one of them out."
            )
        if self.betas is not None:
            parse_betas(self.betas)
        if self.shape and not self.words():
            raise DsnetError("an empty --shape", "names or measurements", "Pass --shape tall.")
        parse_shape(self.words())

    def words(self) -> list[str]:
        """The shape's, one by one."""
        return [word for text in self.shape for word in text.replace(",", " ").split()]

    def given(self) -> dict[str, Any]:
        """Those that are not left at their default, by name."""
        values = [(field.name, getattr(self, field.name), field.default) for field in _fields()]
        return {name: value for name, value, default in values if value != default}


def _fields() -> tuple[Field, ...]:
    """Of `Controls` alone: a command's configuration has more."""
    return fields(Controls)


def controlled_body(character: Character, motion: Motion, controls: Controls) -> MovingBody:
    """A character that performs a motion as an animator asks.

    Parameters
    ----------
    character : who moves.
    motion : as its file has it, read with `motion_fps` and `smooth_hz` if the controls have them.
    controls : what is asked.

    Raises
    ------
    DsnetError
        If something asked for does not exist, is out of reach or does not go together, or the
        motion is not one of a body of a person's size.
    """
    controls.check()
    _check_reading(motion, controls)
    body = character.body
    gain = vertex_gain(body, controls.gain, controls.part_gain)
    placed = place_motion(motion, body, asked_betas(body, controls))
    own = motion.about_root_joint(root_joint_m(body, motion.betas))
    placed, lap = stage_motion(placed, body, own, controls.floor, controls.loop)
    if lap is not None:
        if lap.dropped:
            notify(f"the last frame of {motion.source} is its first again: left out of the loop")
        character = replace(character, predict=LoopedPredictor(character.predict, lap))
    return MovingBody(character, placed, gain, controls.given())


def _check_reading(motion: Motion, controls: Controls) -> None:
    if controls.motion_fps not in (None, motion.source_fps):
        raise DsnetError(
            f"{motion.source}, read at {motion.source_fps:g} frames a second",
            f"it at {controls.motion_fps:g}, as the controls say",
            f"Read it by load_motion_file(path, {controls.motion_fps:g}).",
        )
    if controls.smooth_hz not in (None, motion.smooth_hz):
        raise DsnetError(
            f"{motion.source}, {described(motion.smooth_hz)}",
            f"it {described(controls.smooth_hz)}, as the controls say",
            f"Read it by load_motion_file(path, smooth_hz={controls.smooth_hz!r}).",
        )


def stage_motion(
    placed: Motion, body: BodyModelData, own: Motion, floor: Floor, loop: bool
) -> tuple[Motion, Lap | None]:
    """A motion as it stands on the floor, and as one lap if it is to repeat, with that lap.

    Parameters
    ----------
    placed : y up, about the root joint of the body that performs it.
    body : the model of that body.
    own : the same motion of the body whose it is.

    Raises
    ------
    DsnetError
        If the motion cannot repeat, or is of a body without legs.
    """
    placed = put_on_floor(placed, body, floor, own)
    if not loop:
        return placed, None
    if len(pieces := pieces_between_cuts(placed.theta)) > 1:
        raise DsnetError(
            f"--loop with {placed.source}, which jumps at frame {pieces[1].start}",
            "a motion without cuts",
            REMEDY,
        )
    lap = close_lap(placed.theta, root_joint_m(body, placed.betas))
    return replace(placed, theta=lap.theta), lap


def asked_betas(body: BodyModelData, controls: Controls) -> NDArray[np.float64] | None:
    """(10,) betas of the shape that is asked for; None where the motion's own is meant.

    Raises
    ------
    DsnetError
        If they are no ten numbers, or the shape is unknown or out of reach.
    """
    if controls.betas is not None:
        return parse_betas(controls.betas)
    return find_shape(body, controls.words()) if controls.shape else None


def parse_betas(text: str) -> NDArray[np.float64]:
    """(10,) numbers of the text of `--betas`.

    Raises
    ------
    DsnetError
        If they are not ten, or not finite.
    """
    try:
        betas = np.array([float(part) for part in text.split(",")])
    except ValueError:
        betas = np.empty(0)
    if betas.shape != (N_BETAS,) or not np.isfinite(betas).all():
        raise DsnetError(
            f"--betas {text}", f"{N_BETAS} finite numbers", "Separate them by commas, no spaces."
        )
    return betas
