"""Procedural motions under Dyna's names, and held-out kinds: MoSh's (Section 3.2) and more.

A motion is a plan over time (`plan.py`): the pelvis's path, the feet's places, the joints above.
`posing.py` turns it into the paper's pose vector for the proportions of one subject.
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
    # MoSh's.
    airborne.side_to_side_hopping,
    airborne.basketball_dribble_and_shoot,
    in_place.kicking,
    # Everyday's.
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
"""What is not done again and again, and how long it takes at the slowest tempo, seconds."""


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
    """
    if motion not in MOTIONS:
        raise DsnetError(f"motion {motion!r}", f"one of {', '.join(MOTIONS)}", "Check its name.")
    occasion = motion if take == 1 else f"{motion}{take_suffix(take)}"
    times_s = np.arange(frame_count) / fps
    planner = Planner.drawn(subject, occasion, times_s, skeleton.size, seed)
    return pose_body(skeleton, MOTIONS[motion](planner))
