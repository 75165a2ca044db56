"""Held-out motions that bring the trunk down and up again: sitting, lying, bending, stretching."""

from __future__ import annotations

import numpy as np

from torch_align_ae.corpus.motions.curves import axis, ease, keyframes
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, Style
from torch_align_ae.corpus.motions.postures import RELAXED_LOWER, arm, arms, standing_foot, trunk

BEGIN_S = 0.2


def sitting_down(times_s: Array, style: Style) -> BodyPlan:
    """Sits down on a stool and stands up, again and again."""
    size, tempo = style.size, style.tempo
    phases_s = np.array([0.0, 0.55, 0.95, 1.35, 1.75, 2.2, 2.6]) / tempo
    seat, lean = (np.zeros(times_s.shape) for _ in range(2))
    for start_s in np.arange(BEGIN_S, times_s[-1] + 1.0, phases_s[-1]).tolist():
        seat += keyframes(times_s, start_s + phases_s[[0, 2, 3, 5]], [0.0, 1.0, 1.0, 0.0])
        lean += keyframes(times_s, start_s + phases_s[:6], [0.0, 0.9, 0.05, 0.05, 1.0, 0.0])
    lean = lean * style.amplitude
    sway = np.sin(1.1 * times_s + style.phase) * ease(times_s, BEGIN_S, BEGIN_S + 1.0)
    foot = standing_foot(times_s)
    return BodyPlan(
        pelvis_m=axis(
            times_s,
            0.006 * sway,
            (-0.37 * seat - 0.03 * lean) * size,
            (-0.27 * seat - 0.05 * lean) * size,
        ),
        pelvis_turn=axis(times_s, 0.5 * lean - 0.06 * seat, 0.03 * sway, 0.0),
        left_foot=foot,
        right_foot=foot,
        joints={
            **trunk(times_s, bend=0.35 * lean + 0.06 * seat, turn=0.05 * sway),
            **arms(
                times_s,
                lower=RELAXED_LOWER + 0.2 * seat,
                swing=0.55 * lean + 0.45 * seat,
                elbow=0.25 + 0.35 * seat,
            ),
        },
    )


def lying_down_and_getting_up(times_s: Array, style: Style) -> BodyPlan:
    """Squats, sits on the floor, rolls back until the trunk lies, rests, and comes back up."""
    size, tempo = style.size, style.tempo
    moments_s = BEGIN_S + np.array([0.0, 0.6, 1.1, 1.25, 2.0, 2.5, 3.15, 3.3, 3.85, 4.6]) / tempo
    low = keyframes(times_s, moments_s[[0, 2, 7, 9]], [0.0, 1.0, 1.0, 0.0])
    back = keyframes(times_s, moments_s[[0, 2, 3, 4, 5, 6, 7, 9]], [0, 1, 1, 1.4, 1.4, 1, 1, 0])
    turn = keyframes(
        times_s,
        moments_s,
        [0.0, 0.55, -0.15, -0.2, -np.pi / 2, -np.pi / 2, -0.2, -0.1, 0.65, 0.0],
    )
    curl = keyframes(times_s, moments_s, [0.0, 0.35, 0.45, 0.5, 0.0, 0.0, 0.6, 0.5, 0.4, 0.0])
    reach = keyframes(times_s, moments_s, [0.0, 1.7, 1.2, 1.2, -0.1, -0.1, 1.3, 1.3, 1.7, 0.0])
    lying = keyframes(times_s, moments_s[3:7], [0.0, 1.0, 1.0, 0.0])
    foot = standing_foot(times_s)
    side = style.leading_side
    tilt = 0.06 * side * style.amplitude * low * (1 - lying)
    return BodyPlan(
        pelvis_m=axis(times_s, 0.0, -0.72 * low * size, -0.42 * back * size),
        pelvis_turn=axis(times_s, turn, 0.0, 0.0),
        left_foot=foot,
        right_foot=foot,
        joints={
            **trunk(times_s, bend=curl, turn=tilt),
            **arms(
                times_s,
                lower=RELAXED_LOWER + 0.15 * low,
                swing=0.9 * reach,
                elbow=0.25 + 0.35 * low,
            ),
        },
        carried=keyframes(times_s, moments_s[[1, 2, 7, 8]], [0.0, 1.0, 1.0, 0.0]),
    )


def bending_and_reaching(times_s: Array, style: Style) -> BodyPlan:
    """Bends down to the floor with both hands, then reaches up high on the toes."""
    size = style.size
    phases_s = np.array([0.0, 0.75, 1.0, 1.9, 2.15, 2.8]) / style.tempo
    down, up = (np.zeros(times_s.shape) for _ in range(2))
    for start_s in np.arange(BEGIN_S, times_s[-1] + 1.0, phases_s[-1]).tolist():
        down += keyframes(times_s, start_s + phases_s[:4], [0.0, 1.0, 1.0, 0.0])
        up += keyframes(times_s, start_s + phases_s[2:], [0.0, 1.0, 1.0, 0.0])
    up = up * min(style.amplitude, 1.0)
    foot = standing_foot(times_s, pitch=0.4 * up)
    turn = 0.12 * style.leading_side * down
    return BodyPlan(
        pelvis_m=axis(
            times_s, 0.0, (-0.16 * down + 0.05 * up) * size, (-0.2 * down + 0.05 * up) * size
        ),
        pelvis_turn=axis(times_s, 1.15 * down - 0.05 * up, 0.0, 0.0),
        left_foot=foot,
        right_foot=foot,
        joints={
            **trunk(times_s, bend=0.85 * down - 0.15 * up, turn=turn),
            **arms(
                times_s,
                lower=RELAXED_LOWER + 0.3 * down + 0.3 * up,
                swing=1.9 * down + 2.85 * up,
                elbow=0.25 - 0.1 * down - 0.1 * up,
                shrug=0.2 * up,
            ),
        },
    )


def stretching(times_s: Array, style: Style) -> BodyPlan:
    """Raises the arms, bends to one side and the other, and twists."""
    raised = ease(times_s, BEGIN_S, BEGIN_S + 0.7 / style.tempo)
    phases_s = np.array([0.0, 0.6, 1.3, 1.9, 2.5, 3.0]) / style.tempo
    aside, twist = (np.zeros(times_s.shape) for _ in range(2))
    for start_s in np.arange(BEGIN_S + 0.5, times_s[-1] + 1.0, phases_s[-1]).tolist():
        aside += keyframes(times_s, start_s + phases_s[[0, 1, 2, 3]], [0.0, 1.0, -1.0, 0.0])
        twist += keyframes(times_s, start_s + phases_s[[2, 3, 4, 5]], [0.0, 1.0, -0.8, 0.0])
    aside, twist = (style.leading_side * style.amplitude * curve for curve in (aside, twist))
    foot = standing_foot(times_s)
    joints = trunk(times_s, bend=-0.05 * raised, turn=0.55 * twist, roll=0.55 * aside)
    for name, side in (("left", 1), ("right", -1)):
        joints |= arm(
            times_s,
            name,
            lower=RELAXED_LOWER - (2.2 + 0.12 * side * aside) * raised,
            elbow=0.25 + 0.45 * raised,
            shrug=0.2 * raised,
        )
    return BodyPlan(
        pelvis_m=axis(times_s, 0.06 * aside, -0.012 * raised, 0.0) * style.size,
        pelvis_turn=axis(times_s, 0.0, 0.22 * twist, -0.06 * aside),
        left_foot=foot,
        right_foot=foot,
        joints=joints,
    )
