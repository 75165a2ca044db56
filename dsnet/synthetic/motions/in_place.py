"""Motions with at least one foot on the floor: Dyna's, and held-out ones."""

from __future__ import annotations

from functools import partial

import numpy as np

from dsnet.synthetic.motions.plan import (
    BEGIN_S,
    RELAXED_LOWER,
    BodyPlan,
    FootPath,
    Planner,
    Step,
    by_side,
)


def hips(m: Planner) -> BodyPlan:
    """Wide, slow circles of the pelvis."""
    phase = m.cycle(0.95 * m.tempo, BEGIN_S)
    depth = m.amplitude * m.ease(BEGIN_S, BEGIN_S + 0.9)
    side = m.leading_side * np.sin(phase) * depth
    front = np.cos(phase) * depth
    pelvis_m = m.axis(0.075 * side, -0.045 * depth, 0.055 * front) * m.size
    pelvis_turn = m.axis(-0.12 * front, 0.06 * side, -0.12 * side)
    spine = m.spine(0.15 * front, -0.08 * side, 0.2 * side)
    arms = m.arms(lower=0.75, twist=-0.2, elbow=0.5)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)


def shake_hips(m: Planner) -> BodyPlan:
    """Quick shakes of the pelvis from side to side."""
    phase = m.cycle(2.5 * m.tempo, BEGIN_S)
    depth = m.amplitude * m.ease(BEGIN_S, BEGIN_S + 0.6)
    # The amplitude varies slowly, as in a real motion.
    depth = depth * (0.8 + 0.2 * np.sin(0.31 * phase + m.phase))
    side = m.leading_side * np.sin(phase) * depth
    twist = np.sin(phase + 0.8) * depth
    pelvis_m = m.axis(0.035 * side, -0.045 * depth, 0.01 * twist) * m.size
    pelvis_turn = m.axis(0.05 * depth, 0.16 * twist, -0.13 * side)
    spine = m.spine(-0.05 * depth, -0.18 * twist, 0.14 * side)
    arms = m.arms(lower=0.85, elbow=0.9 + 0.1 * twist, swing=0.15)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)


def knees(m: Planner) -> BodyPlan:
    """Knees raised high in turn, as in marching on the spot."""
    step_s = 0.52 / m.tempo
    starts_s = m.starts_s(BEGIN_S + 0.25, step_s)
    sides = m.sides(starts_s)
    lifts_m = 0.38 * m.size * m.amplitude * (1 + 0.06 * m.rng().standard_normal(len(sides)))
    step = partial(Step, back_m=0.05 * m.size, take_off_pitch=0.35, pitch=0.55, landing_pitch=0.15)
    steps = [
        step(at_s, at_s + 0.95 * step_s, lift_m, side=side)
        for at_s, lift_m, side in zip(starts_s, lifts_m, sides, strict=True)
    ]
    lean = m.keyframes([BEGIN_S, *(starts_s + 0.3 * step_s)], [0, *-sides])
    sway = np.sin(np.pi * lean / 2)
    pelvis_m = m.axis(0.075 * lean, -0.012 * np.abs(sway), 0.0) * m.size
    pelvis_turn = m.axis(0.0, -0.08 * sway, 0.03 * sway)
    spine = m.spine(0.05, 0.14 * sway)
    arms = m.arms(swing=(0.45 * sway, -0.45 * sway), elbow=0.7)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, m.feet(steps))


def jiggle_on_toes(m: Planner) -> BodyPlan:
    """Heels up, bouncing quickly on the balls of the feet."""
    phase = m.cycle(3.4 * m.tempo, BEGIN_S + 0.4)
    raised = m.ease(BEGIN_S, BEGIN_S + 0.5)
    depth = m.amplitude * m.ease(BEGIN_S + 0.4, BEGIN_S + 1.0)
    bounce = (np.cos(phase) - 1) * depth
    sway = np.sin(0.13 * phase + m.phase) * depth
    foot = FootPath(pitch=0.5 * raised + 0.05 * bounce)
    pelvis_m = m.axis(0.01 * sway, 0.055 * raised + 0.013 * bounce, 0.055 * raised) * m.size
    pelvis_turn = m.axis(-0.02 * bounce, 0.03 * sway, 0.0)
    spine = m.spine(0.02 * bounce)
    arms = m.arms(lower=1.05 + 0.03 * bounce, elbow=0.45 - 0.05 * bounce)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, (foot, foot))


def one_leg_loose(m: Planner) -> BodyPlan:
    """Standing on one leg, the other is shaken loosely."""
    support = -m.leading_side
    raised = m.ease(BEGIN_S, BEGIN_S + 0.7)
    phase = m.cycle(2.3 * m.tempo, BEGIN_S + 0.7)
    depth = m.amplitude * m.ease(BEGIN_S + 0.7, BEGIN_S + 1.2)
    shake = np.sin(phase) * depth
    drift = np.sin(0.17 * phase + m.phase) * depth
    aside = -support * (0.05 * raised + 0.02 * drift)
    lift = 0.20 * raised + 0.045 * (1 - np.cos(phase)) * depth
    loose = FootPath(
        m.axis(aside, lift, 0.14 * raised + 0.10 * shake) * m.size,
        pitch=0.55 * raised + 0.25 * np.sin(phase - 0.9) * depth,
        yaw=-support * 0.1 * raised,
    )
    over = support * 0.1 * raised
    pelvis_m = m.axis(over, -0.01 * raised + 0.004 * shake, -0.01 * raised) * m.size
    pelvis_turn = m.axis(0.0, support * 0.04 * shake, -support * 0.04 * raised)
    spine = m.spine(0.05 * raised, -support * 0.06 * shake, support * 0.06 * raised)
    arms = m.arms(lower=1.12 - 0.4 * raised + 0.04 * shake, elbow=0.35)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, by_side(support, FootPath(), loose))


def shake_arms(m: Planner) -> BodyPlan:
    """Arms held out and shaken loosely."""
    raised = m.ease(BEGIN_S, BEGIN_S + 0.6)
    phase = m.cycle(3.0 * m.tempo, BEGIN_S + 0.4)
    depth = m.amplitude * m.ease(BEGIN_S + 0.4, BEGIN_S + 0.9)
    drift = 0.25 * np.sin(0.12 * phase + m.phase) * depth
    shake, lagging = np.sin(phase) * depth, np.sin(phase - 0.9) * depth
    pelvis_m = m.axis(0.0, -0.02 * raised + 0.004 * shake, 0.0) * m.size
    pelvis_turn = m.axis(0.03 * raised, 0.03 * drift, 0.0)
    spine = m.spine(0.03 * shake, 0.1 * drift)
    arms = m.arms(
        lower=1.12 - 0.62 * raised + drift + 0.26 * shake,
        swing=0.25 * raised,
        elbow=0.3 + 0.25 * raised + 0.3 * lagging,
        shrug=0.05 * shake,
    )
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)


def chicken_wings(m: Planner) -> BodyPlan:
    """Hands at the chest, elbows flapping up and down."""
    raised = m.ease(BEGIN_S, BEGIN_S + 0.6)
    phase = m.cycle(1.7 * m.tempo, BEGIN_S + 0.4)
    depth = m.amplitude * m.ease(BEGIN_S + 0.4, BEGIN_S + 1.0)
    flap, dip = np.sin(phase) * depth, (1 - np.cos(phase)) / 2 * depth
    pelvis_m = m.axis(0.0, -0.02 * raised - 0.02 * dip, 0.0) * m.size
    pelvis_turn = m.axis(0.05 * raised + 0.03 * dip, 0.0, 0.0)
    spine = m.spine(0.06 * dip)
    arms = m.arms(
        lower=1.12 - 0.52 * raised - 0.5 * flap,
        swing=0.15 * raised,
        twist=0.1 * raised,
        elbow=0.25 + 2.0 * raised - 0.08 * flap,
        shrug=0.08 * flap,
    )
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)


def shake_shoulders(m: Planner) -> BodyPlan:
    """Shoulders shaken forwards and back in turn."""
    phase = m.cycle(2.8 * m.tempo, BEGIN_S)
    held = m.ease(BEGIN_S, BEGIN_S + 0.6)
    depth = m.amplitude * held * (0.85 + 0.15 * np.sin(0.23 * phase + m.phase))
    shake = m.leading_side * np.sin(phase) * depth
    lean = np.sin(0.15 * phase) * depth
    pelvis_m = m.axis(0.004 * shake, -0.025 * held, -0.01 * held) * m.size
    pelvis_turn = m.axis(0.04 * held, -0.05 * shake, 0.0)
    spine = m.spine(0.08 * held + 0.06 * lean, 0.30 * shake)
    arms = m.arms(
        lower=1.0,
        shrug=(0.12 * shake, -0.12 * shake),
        swing=(-0.12 * shake, 0.12 * shake),
        elbow=0.6,
    )
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)


def punching(m: Planner) -> BodyPlan:
    """Straight punches in turn from a guard."""
    guard = m.ease(BEGIN_S, BEGIN_S + 0.5)
    punch_s = 0.42 / m.tempo
    starts_s = m.starts_s(BEGIN_S + 0.5, punch_s)
    sides = m.sides(starts_s)
    strength = m.amplitude * (1 + 0.05 * m.rng().standard_normal(len(sides)))
    left, right = m.zeros(), m.zeros()
    moments_s = punch_s * np.array([0.0, 0.55, 1.25])
    for start_s, side, share in zip(starts_s, sides, strength.tolist(), strict=True):
        out = left if side == 1 else right
        out += min(share, 1.05) * m.keyframes(start_s + moments_s, [0.0, 1.0, 0.0])
    turn = 0.30 * (right - left)
    pelvis_m = m.axis(0.03 * (right - left), -0.05 * guard, 0.0) * m.size
    pelvis_turn = m.axis(0.06 * guard, 0.45 * turn, 0.0)
    spine = m.spine(0.12 * guard, turn)
    arms = m.arms(
        lower=(1.12 + 0.08 * guard + 0.15 * left, 1.12 + 0.08 * guard + 0.15 * right),
        swing=(0.35 * guard + 1.0 * left, 0.35 * guard + 1.0 * right),
        twist=-0.1 * guard,
        elbow=(0.25 + 1.75 * guard - 1.75 * left, 0.25 + 1.75 * guard - 1.75 * right),
    )
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)


def kicking(m: Planner) -> BodyPlan:
    """Kicks to the front with one leg, the other stands."""
    support = -m.leading_side
    starts_s = m.starts_s(BEGIN_S + 0.35, 1.55 / m.tempo)
    variation = 1 + 0.05 * m.rng().standard_normal(len(starts_s))
    strength = np.minimum(m.amplitude * variation, 1.08)
    back, front, lift, cocked = (m.zeros() for _ in range(4))
    for start_s, share in zip(starts_s.tolist(), strength.tolist(), strict=True):
        moments_s = start_s + np.array([0.0, 0.38, 0.54, 0.72, 1.25]) / m.tempo
        back += m.keyframes(moments_s[[0, 1, 3]], [0.0, 1.0, 0.0])
        front += share * m.keyframes(moments_s[[1, 3, 4]], [0.0, 1.0, 0.0])
        lift += m.keyframes(moments_s, [0.0, 0.22, 0.12, 0.40 * share, 0.0])
        cocked += m.keyframes(moments_s[[0, 1, 3, 4]], [0.0, 0.9, 0.45, 0.0])
    ball_m = m.axis(-support * 0.03 * front, lift, -0.38 * back + 0.62 * front) * m.size
    kicks = FootPath(ball_m, pitch=cocked)
    raised = m.ease(BEGIN_S, BEGIN_S + 0.4)
    turn = support * 0.3 * (front - back)
    swing = support * 0.6 * (front - 0.7 * back)
    pelvis_m = m.axis(support * 0.1 * raised, -0.025 * raised, 0.03 * back + 0.02 * front) * m.size
    pelvis_turn = m.axis(0.12 * back - 0.14 * front, 0.6 * turn, -support * 0.05 * raised)
    spine = m.spine(0.22 * front, -1.1 * turn, support * 0.06 * raised)
    arms = m.arms(lower=RELAXED_LOWER - 0.3 * raised, swing=(-swing, swing), elbow=0.4)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, by_side(support, FootPath(), kicks))


def sitting_down(m: Planner) -> BodyPlan:
    """Sits down on a stool and stands up, again and again."""
    phases_s = np.array([0.0, 0.55, 0.95, 1.35, 1.75, 2.2, 2.6]) / m.tempo
    starts_s = m.starts_s(BEGIN_S, phases_s[-1])
    seat = m.repeated(starts_s, phases_s[[0, 2, 3, 5]], [0.0, 1.0, 1.0, 0.0])
    lean = m.repeated(starts_s, phases_s[:6], [0.0, 0.9, 0.05, 0.05, 1.0, 0.0])
    lean = lean * m.amplitude
    sway = np.sin(1.1 * m.times_s + m.phase) * m.ease(BEGIN_S, BEGIN_S + 1.0)
    height_m, front_m = -0.37 * seat - 0.03 * lean, -0.27 * seat - 0.05 * lean
    pelvis_m = m.axis(0.006 * sway, height_m * m.size, front_m * m.size)
    pelvis_turn = m.axis(0.5 * lean - 0.06 * seat, 0.03 * sway, 0.0)
    spine = m.spine(0.35 * lean + 0.06 * seat, 0.05 * sway)
    arms = m.arms(
        lower=RELAXED_LOWER + 0.2 * seat, swing=0.55 * lean + 0.45 * seat, elbow=0.25 + 0.35 * seat
    )
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)


def lying_down_and_getting_up(m: Planner) -> BodyPlan:
    """Squats, sits on the floor, rolls back until the trunk lies, rests, and comes back up."""
    phases_s = np.array([0.0, 0.6, 1.1, 1.25, 2.0, 2.5, 3.15, 3.3, 3.85, 4.6]) / m.tempo
    moments_s = BEGIN_S + phases_s
    low = m.keyframes(moments_s[[0, 2, 7, 9]], [0.0, 1.0, 1.0, 0.0])
    back = m.keyframes(moments_s[[0, 2, 3, 4, 5, 6, 7, 9]], [0, 1, 1, 1.4, 1.4, 1, 1, 0])
    lain = -np.pi / 2
    turn = m.keyframes(moments_s, [0.0, 0.55, -0.15, -0.2, lain, lain, -0.2, -0.1, 0.65, 0.0])
    curl = m.keyframes(moments_s, [0.0, 0.35, 0.45, 0.5, 0.0, 0.0, 0.6, 0.5, 0.4, 0.0])
    reach = m.keyframes(moments_s, [0.0, 1.7, 1.2, 1.2, -0.1, -0.1, 1.3, 1.3, 1.7, 0.0])
    lying = m.keyframes(moments_s[3:7], [0.0, 1.0, 1.0, 0.0])
    tilt = 0.06 * m.leading_side * m.amplitude * low * (1 - lying)
    pelvis_m = m.axis(0.0, -0.72 * low, -0.42 * back) * m.size
    pelvis_turn = m.axis(turn, 0.0, 0.0)
    on_floor = m.keyframes(moments_s[[1, 2, 7, 8]], [0.0, 1.0, 1.0, 0.0])
    spine = m.spine(curl, tilt)
    arms = m.arms(lower=RELAXED_LOWER + 0.15 * low, swing=0.9 * reach, elbow=0.25 + 0.35 * low)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, on_floor=on_floor)


def bending_and_reaching(m: Planner) -> BodyPlan:
    """Bends down to the floor with both hands, then reaches up high on the toes."""
    phases_s = np.array([0.0, 0.75, 1.0, 1.9, 2.15, 2.8]) / m.tempo
    starts_s = m.starts_s(BEGIN_S, phases_s[-1])
    down = m.repeated(starts_s, phases_s[:4], [0.0, 1.0, 1.0, 0.0])
    up = m.repeated(starts_s, phases_s[2:], [0.0, 1.0, 1.0, 0.0])
    up = up * min(m.amplitude, 1.0)
    foot = FootPath(pitch=0.4 * up)
    pelvis_m = m.axis(0.0, -0.16 * down + 0.05 * up, -0.2 * down + 0.05 * up) * m.size
    pelvis_turn = m.axis(1.15 * down - 0.05 * up, 0.0, 0.0)
    spine = m.spine(0.85 * down - 0.15 * up, 0.12 * m.leading_side * down)
    arms = m.arms(
        lower=RELAXED_LOWER + 0.3 * down + 0.3 * up,
        swing=1.9 * down + 2.85 * up,
        elbow=0.25 - 0.1 * down - 0.1 * up,
        shrug=0.2 * up,
    )
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, (foot, foot))


def stretching(m: Planner) -> BodyPlan:
    """Raises the arms, bends to one side and the other, and twists."""
    raised = m.ease(BEGIN_S, BEGIN_S + 0.7 / m.tempo)
    phases_s = np.array([0.0, 0.6, 1.3, 1.9, 2.5, 3.0]) / m.tempo
    starts_s = m.starts_s(BEGIN_S + 0.5, phases_s[-1])
    aside = m.repeated(starts_s, phases_s[:4], [0.0, 1.0, -1.0, 0.0])
    twist = m.repeated(starts_s, phases_s[2:], [0.0, 1.0, -0.8, 0.0])
    aside, twist = (m.leading_side * m.amplitude * curve for curve in (aside, twist))
    left, right = (RELAXED_LOWER - (2.2 + bent * aside) * raised for bent in (0.12, -0.12))
    pelvis_m = m.axis(0.06 * aside, -0.012 * raised, 0.0) * m.size
    pelvis_turn = m.axis(0.0, 0.22 * twist, -0.06 * aside)
    spine = m.spine(-0.05 * raised, 0.55 * twist, 0.55 * aside)
    arms = m.arms(lower=(left, right), elbow=0.25 + 0.45 * raised, shrug=0.2 * raised)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms)
