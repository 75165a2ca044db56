"""Motions whose feet stay on the floor, or leave it one at a time."""

from __future__ import annotations

import numpy as np

from torch_align_ae.corpus.motions.curves import axis, bump, cycle, ease, keyframes
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, FootPath, Style
from torch_align_ae.corpus.motions.postures import (
    Swing,
    arm,
    arms,
    contacts_between,
    standing_foot,
    stepping_foot,
    trunk,
)

BEGIN_S = 0.2


def hips(times_s: Array, style: Style) -> BodyPlan:
    """Wide, slow circles of the pelvis."""
    phase = cycle(times_s, 0.95 * style.tempo, BEGIN_S)
    depth = style.amplitude * ease(times_s, BEGIN_S, BEGIN_S + 0.9)
    side = style.leading_side * np.sin(phase) * depth
    front = np.cos(phase) * depth
    return _planted(
        times_s,
        pelvis_m=axis(times_s, 0.075 * side, -0.045 * depth, 0.055 * front) * style.size,
        pelvis_turn=axis(times_s, -0.12 * front, 0.06 * side, -0.12 * side),
        joints={
            **trunk(times_s, bend=0.15 * front, turn=-0.08 * side, roll=0.2 * side),
            **arms(times_s, lower=0.75, twist=-0.2, elbow=0.5),
        },
    )


def shake_hips(times_s: Array, style: Style) -> BodyPlan:
    """Quick shakes of the pelvis from side to side."""
    phase = cycle(times_s, 2.5 * style.tempo, BEGIN_S)
    depth = style.amplitude * ease(times_s, BEGIN_S, BEGIN_S + 0.6)
    # The strength comes and goes, as nobody shakes evenly.
    depth = depth * (0.8 + 0.2 * np.sin(0.31 * phase + style.phase))
    side = style.leading_side * np.sin(phase) * depth
    twist = np.sin(phase + 0.8) * depth
    return _planted(
        times_s,
        pelvis_m=axis(times_s, 0.035 * side, -0.045 * depth, 0.01 * twist) * style.size,
        pelvis_turn=axis(times_s, 0.05 * depth, 0.16 * twist, -0.13 * side),
        joints={
            **trunk(times_s, bend=-0.05 * depth, turn=-0.18 * twist, roll=0.14 * side),
            **arms(times_s, lower=0.85, elbow=0.9 + 0.1 * twist, swing=0.15),
        },
    )


def knees(times_s: Array, style: Style) -> BodyPlan:
    """Knees raised high in turn, as in marching on the spot."""
    step_s = 0.52 / style.tempo
    starts_s = np.arange(BEGIN_S + 0.25, times_s[-1] + 1.0, step_s)
    sides = style.leading_side * (-1) ** np.arange(len(starts_s))
    lifts_m = (
        0.38 * style.size * style.amplitude * (1 + 0.06 * style.rng().standard_normal(len(sides)))
    )
    raised = {side: np.zeros(times_s.shape) for side in (1, -1)}
    for start_s, side in zip(starts_s.tolist(), sides.tolist(), strict=True):
        raised[side] += bump(times_s, start_s, start_s + 1.05 * step_s)
    feet = {}
    for side in (1, -1):
        own = sides == side
        contacts = contacts_between(starts_s[own], starts_s[own] + 0.95 * step_s)
        swings = [
            Swing(
                lift, back_m=0.05 * style.size, take_off_pitch=0.35, pitch=0.55, landing_pitch=0.15
            )
            for lift in lifts_m[own]
        ]
        feet[side] = stepping_foot(times_s, contacts, swings)
    lean = keyframes(
        times_s,
        np.concatenate([[BEGIN_S], starts_s + 0.3 * step_s]),
        np.concatenate([[0.0], -sides.astype(float)]),
    )
    sway = np.sin(np.pi * lean / 2)
    return BodyPlan(
        pelvis_m=axis(times_s, 0.075 * lean, -0.012 * np.abs(sway), 0.0) * style.size,
        pelvis_turn=axis(times_s, 0.0, -0.08 * sway, 0.03 * sway),
        left_foot=feet[1],
        right_foot=feet[-1],
        joints={
            **trunk(times_s, bend=0.05, turn=0.14 * sway),
            **arm(times_s, "left", swing=0.45 * sway, elbow=0.7),
            **arm(times_s, "right", swing=-0.45 * sway, elbow=0.7),
        },
    )


def jiggle_on_toes(times_s: Array, style: Style) -> BodyPlan:
    """Heels up, bouncing quickly on the balls of the feet."""
    phase = cycle(times_s, 3.4 * style.tempo, BEGIN_S + 0.4)
    raised = ease(times_s, BEGIN_S, BEGIN_S + 0.5)
    depth = style.amplitude * ease(times_s, BEGIN_S + 0.4, BEGIN_S + 1.0)
    bounce = (np.cos(phase) - 1) * depth
    sway = np.sin(0.13 * phase + style.phase) * depth
    return _planted(
        times_s,
        pelvis_m=axis(times_s, 0.01 * sway, 0.055 * raised + 0.013 * bounce, 0.055 * raised)
        * style.size,
        pelvis_turn=axis(times_s, -0.02 * bounce, 0.03 * sway, 0.0),
        joints={
            **trunk(times_s, bend=0.02 * bounce),
            **arms(times_s, lower=1.05 + 0.03 * bounce, elbow=0.45 - 0.05 * bounce),
        },
        pitch=0.5 * raised + 0.05 * bounce,
    )


def one_leg_loose(times_s: Array, style: Style) -> BodyPlan:
    """Standing on one leg, the other is shaken loosely."""
    support = -style.leading_side
    raised = ease(times_s, BEGIN_S, BEGIN_S + 0.7)
    phase = cycle(times_s, 2.3 * style.tempo, BEGIN_S + 0.7)
    depth = style.amplitude * ease(times_s, BEGIN_S + 0.7, BEGIN_S + 1.2)
    shake = np.sin(phase) * depth
    drift = np.sin(0.17 * phase + style.phase) * depth
    loose = FootPath(
        axis(
            times_s,
            -support * (0.05 * raised + 0.02 * drift),
            0.20 * raised + 0.045 * (1 - np.cos(phase)) * depth,
            0.14 * raised + 0.10 * shake,
        )
        * style.size,
        pitch=0.55 * raised + 0.25 * np.sin(phase - 0.9) * depth,
        yaw=-support * 0.1 * raised,
    )
    planted = standing_foot(times_s)
    return BodyPlan(
        pelvis_m=axis(
            times_s, support * 0.1 * raised, -0.01 * raised + 0.004 * shake, -0.01 * raised
        )
        * style.size,
        pelvis_turn=axis(times_s, 0.0, support * 0.04 * shake, -support * 0.04 * raised),
        left_foot=planted if support == 1 else loose,
        right_foot=loose if support == 1 else planted,
        joints={
            **trunk(
                times_s,
                bend=0.05 * raised,
                turn=-support * 0.06 * shake,
                roll=support * 0.06 * raised,
            ),
            **arms(times_s, lower=1.12 - 0.4 * raised + 0.04 * shake, elbow=0.35),
        },
    )


def shake_arms(times_s: Array, style: Style) -> BodyPlan:
    """Arms held out and shaken loosely."""
    raised = ease(times_s, BEGIN_S, BEGIN_S + 0.6)
    phase = cycle(times_s, 3.0 * style.tempo, BEGIN_S + 0.4)
    depth = style.amplitude * ease(times_s, BEGIN_S + 0.4, BEGIN_S + 0.9)
    drift = 0.25 * np.sin(0.12 * phase + style.phase) * depth
    shake = np.sin(phase) * depth
    late = np.sin(phase - 0.9) * depth
    joints = arms(
        times_s,
        lower=1.12 - 0.62 * raised + drift + 0.26 * shake,
        swing=0.25 * raised,
        elbow=0.3 + 0.25 * raised + 0.3 * late,
        shrug=0.05 * shake,
    )
    return _planted(
        times_s,
        pelvis_m=axis(times_s, 0.0, -0.02 * raised + 0.004 * shake, 0.0) * style.size,
        pelvis_turn=axis(times_s, 0.03 * raised, 0.03 * drift, 0.0),
        joints={**trunk(times_s, bend=0.03 * shake, turn=0.1 * drift), **joints},
    )


def chicken_wings(times_s: Array, style: Style) -> BodyPlan:
    """Hands at the chest, elbows flapping up and down."""
    raised = ease(times_s, BEGIN_S, BEGIN_S + 0.6)
    phase = cycle(times_s, 1.7 * style.tempo, BEGIN_S + 0.4)
    depth = style.amplitude * ease(times_s, BEGIN_S + 0.4, BEGIN_S + 1.0)
    flap = np.sin(phase) * depth
    joints = arms(
        times_s,
        lower=1.12 - 0.52 * raised - 0.5 * flap,
        swing=0.15 * raised,
        twist=0.1 * raised,
        elbow=0.25 + 2.0 * raised - 0.08 * flap,
        shrug=0.08 * flap,
    )
    dip = (1 - np.cos(phase)) / 2 * depth
    return _planted(
        times_s,
        pelvis_m=axis(times_s, 0.0, -0.02 * raised - 0.02 * dip, 0.0) * style.size,
        pelvis_turn=axis(times_s, 0.05 * raised + 0.03 * dip, 0.0, 0.0),
        joints={**trunk(times_s, bend=0.06 * dip), **joints},
    )


def shake_shoulders(times_s: Array, style: Style) -> BodyPlan:
    """Shoulders shaken forwards and back in turn."""
    phase = cycle(times_s, 2.8 * style.tempo, BEGIN_S)
    depth = style.amplitude * ease(times_s, BEGIN_S, BEGIN_S + 0.6)
    depth = depth * (0.85 + 0.15 * np.sin(0.23 * phase + style.phase))
    shake = style.leading_side * np.sin(phase) * depth
    lean = np.sin(0.15 * phase) * depth
    held = ease(times_s, BEGIN_S, BEGIN_S + 0.6)
    spine = trunk(times_s, bend=0.08 * held + 0.06 * lean, turn=0.30 * shake)
    return _planted(
        times_s,
        pelvis_m=axis(times_s, 0.004 * shake, -0.025 * held, -0.01 * held) * style.size,
        pelvis_turn=axis(times_s, 0.04 * held, -0.05 * shake, 0.0),
        joints={
            **spine,
            **arm(times_s, "left", lower=1.0, shrug=0.12 * shake, swing=-0.12 * shake, elbow=0.6),
            **arm(times_s, "right", lower=1.0, shrug=-0.12 * shake, swing=0.12 * shake, elbow=0.6),
        },
    )


def punching(times_s: Array, style: Style) -> BodyPlan:
    """Straight punches in turn from a guard."""
    guard = ease(times_s, BEGIN_S, BEGIN_S + 0.5)
    punch_s = 0.42 / style.tempo
    starts_s = np.arange(BEGIN_S + 0.5, times_s[-1] + 1.0, punch_s)
    sides = style.leading_side * (-1) ** np.arange(len(starts_s))
    strength = style.amplitude * (1 + 0.05 * style.rng().standard_normal(len(sides)))
    out = {side: np.zeros(times_s.shape) for side in (1, -1)}
    for start_s, side, share in zip(
        starts_s.tolist(), sides.tolist(), strength.tolist(), strict=True
    ):
        reach = keyframes(times_s, start_s + punch_s * np.array([0.0, 0.55, 1.25]), [0.0, 1.0, 0.0])
        out[side] += min(share, 1.05) * reach
    turn = 0.30 * (out[-1] - out[1])
    joints = trunk(times_s, bend=0.12 * guard, turn=turn)
    for name, side in (("left", 1), ("right", -1)):
        joints |= arm(
            times_s,
            name,
            lower=1.12 + 0.08 * guard + 0.15 * out[side],
            swing=0.35 * guard + 1.0 * out[side],
            twist=-0.1 * guard,
            elbow=0.25 + 1.75 * guard - 1.75 * out[side],
        )
    return _planted(
        times_s,
        pelvis_m=axis(times_s, 0.03 * (out[-1] - out[1]), -0.05 * guard, 0.0) * style.size,
        pelvis_turn=axis(times_s, 0.06 * guard, 0.45 * turn, 0.0),
        joints=joints,
    )


def _planted(
    times_s: Array,
    *,
    pelvis_m: Array,
    pelvis_turn: Array,
    joints: dict[str, Array],
    pitch: Array | float = 0.0,
) -> BodyPlan:
    foot = standing_foot(times_s, pitch=pitch)
    return BodyPlan(pelvis_m, pelvis_turn, foot, foot, joints)
