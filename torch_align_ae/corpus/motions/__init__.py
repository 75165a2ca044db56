"""Procedural motions under Dyna's names, and held-out kinds: MoSh's (Section 3.2) and more.

A motion is a plan over time (`plan.py`): the pelvis's path, the feet's places, the joints above.
`posing.py` turns it into the paper's pose vector for the proportions of one subject.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bridge.errors import DsnetError
from bridge.motion.splits import take_suffix
from torch_align_ae.corpus.motions import airborne, dance, everyday, in_place, locomotion, sports
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, Style, draw_style
from torch_align_ae.corpus.motions.posing import Skeleton, pose_body

DYNA_MOTIONS: dict[str, Callable[[Array, Style], BodyPlan]] = {
    "hips": in_place.hips,
    "knees": in_place.knees,
    "light_hopping_stiff": airborne.light_hopping_stiff,
    "light_hopping_loose": airborne.light_hopping_loose,
    "jiggle_on_toes": in_place.jiggle_on_toes,
    "one_leg_loose": in_place.one_leg_loose,
    "shake_arms": in_place.shake_arms,
    "chicken_wings": in_place.chicken_wings,
    "punching": in_place.punching,
    "shake_shoulders": in_place.shake_shoulders,
    "shake_hips": in_place.shake_hips,
    "jumping_jacks": airborne.jumping_jacks,
    "one_leg_jump": airborne.one_leg_jump,
    "running_on_spot": airborne.running_on_spot,
}
MOSH_MOTIONS: dict[str, Callable[[Array, Style], BodyPlan]] = {
    "side_to_side_hopping": airborne.side_to_side_hopping,
    "basketball_dribble_and_shoot": sports.basketball_dribble_and_shoot,
    "kicking": sports.kicking,
}
HELD_OUT_MOTIONS: dict[str, Callable[[Array, Style], BodyPlan]] = {
    **MOSH_MOTIONS,
    "walking": locomotion.walking,
    "turning": locomotion.turning,
    "quick_stops": locomotion.quick_stops,
    "sitting_down": everyday.sitting_down,
    "lying_down_and_getting_up": everyday.lying_down_and_getting_up,
    "bending_and_reaching": everyday.bending_and_reaching,
    "stretching": everyday.stretching,
    "dancing": dance.dancing,
}
MOTIONS = DYNA_MOTIONS | HELD_OUT_MOTIONS
WHOLE_S = {"lying_down_and_getting_up": 5.6}
"""What is not done again and again, and how long it takes at the slowest tempo, seconds."""

__all__ = [
    "DYNA_MOTIONS",
    "HELD_OUT_MOTIONS",
    "MOSH_MOTIONS",
    "MOTIONS",
    "WHOLE_S",
    "Skeleton",
    "perform",
]


def perform(
    motion: str,
    subject: str,
    skeleton: Skeleton,
    *,
    frame_count: int,
    fps: float,
    seed: int = 0,
    take: int = 1,
) -> Array:
    """theta (T, 69) of `subject` doing `motion`: y up, floor at 0, facing +z, at rest at first.

    The same names, seed and take give the same motion, whatever else is made and at whatever rate;
    another `take` is the same kind of motion in another style.

    Raises
    ------
    DsnetError
        If there is no such motion.
    """
    if motion not in MOTIONS:
        raise DsnetError(f"motion {motion!r}", f"one of {', '.join(MOTIONS)}", "Check its name.")
    occasion = motion if take == 1 else f"{motion}{take_suffix(take)}"
    style = draw_style(subject, occasion, skeleton.size, seed)
    times_s = np.arange(frame_count) / fps
    return pose_body(skeleton, MOTIONS[motion](times_s, style))
