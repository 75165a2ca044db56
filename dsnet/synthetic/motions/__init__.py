"""Procedural motions with Dyna's names, and held-out kinds: MoSh's (Section 3.2) and more.

A motion is planned over time (`plan.py`): path of the pelvis, positions of the feet, joints above.
`posing.py` converts a plan to the paper's pose vector for the proportions of one subject.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bridge.errors import DsnetError
from bridge.motion.splits import take_suffix
from dsnet.synthetic.motions import airborne, in_place, locomotion
from dsnet.synthetic.motions.plan import Array, BodyPlan, Planner
from dsnet.synthetic.motions.posing import Skeleton, pose_body

Motion = Callable[[Planner], BodyPlan]


def _named(*motions: Motion) -> dict[str, Motion]:
    return {motion.__name__: motion for motion in motions}


DYNA_MOTIONS = _named(
    in_place.hips,
    in_place.knees,
    airborne.light_hopping_stiff,
    airborne.light_hopping_loose,
    in_place.jiggle_on_toes,
    in_place.one_leg_loose,
    in_place.shake_arms,
    in_place.chicken_wings,
    in_place.punching,
    in_place.shake_shoulders,
    in_place.shake_hips,
    airborne.jumping_jacks,
    airborne.one_leg_jump,
    airborne.running_on_spot,
)
HELD_OUT_MOTIONS = _named(
    # Of MoSh.
    airborne.side_to_side_hopping,
    airborne.basketball_dribble_and_shoot,
    in_place.kicking,
    # Of everyday life.
    locomotion.walking,
    locomotion.turning,
    locomotion.quick_stops,
    in_place.sitting_down,
    in_place.lying_down_and_getting_up,
    in_place.bending_and_reaching,
    in_place.stretching,
    locomotion.dancing,
)
MOTIONS = DYNA_MOTIONS | HELD_OUT_MOTIONS
WHOLE_S = {"lying_down_and_getting_up": 5.6}
"""Motions that are not periodic, and their duration at the slowest tempo, seconds."""


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

    The motion depends on names, seed and take alone, not on the frame rate or other motions;
    another `take` is the same kind of motion in another style.
    """
    if motion not in MOTIONS:
        raise DsnetError(f"motion {motion!r}", f"one of {', '.join(MOTIONS)}", "Check its name.")
    style_name = motion if take == 1 else f"{motion}{take_suffix(take)}"
    times_s = np.arange(frame_count) / fps
    planner = Planner.drawn(subject, style_name, times_s, skeleton.size, seed)
    return pose_body(skeleton, MOTIONS[motion](planner))
