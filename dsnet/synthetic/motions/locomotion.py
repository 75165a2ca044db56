"""Held-out motions by steps: walking, turning on the spot, runs that stop dead, a dance."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np

from dsnet.synthetic.motions.plan import (
    BEGIN_S,
    RELAXED_LOWER,
    Array,
    BodyPlan,
    Planner,
    Step,
)

# Fraction of a step in which its foot is in the air; in the rest both feet are on the floor.
_SWING = 0.8


def _steady(m: Planner, steady_s: float, reached: float, rate: float, end_s: float) -> Array:
    """A curve that starts from rest and has a constant rate from `steady_s` on."""
    last = reached + rate * (end_s - steady_s)
    knots = [(BEGIN_S, 0.0, 0.0, 0.0), (steady_s, reached, rate, 0.0), (end_s, last, rate, 0.0)]
    return m.track(knots)


def walking(m: Planner) -> BodyPlan:
    """Walks straight ahead."""
    step_s, size = 0.5 / m.tempo, m.size
    length_m = 0.55 * size * m.amplitude
    start_s = BEGIN_S + 0.25
    starts_s = m.starts_s(start_s, step_s)
    sides = m.sides(starts_s)
    step = partial(Step, lift_m=0.07 * size, take_off_pitch=0.75, pitch=0.45, landing_pitch=0.02)
    # The first step is half as long, so that afterwards the body is always between its feet.
    steps = [
        step(at_s, at_s + _SWING * step_s, z_m=(row + 0.5) * length_m, side=side)
        for row, (side, at_s) in enumerate(zip(sides, starts_s, strict=True))
    ]
    steady_s = start_s + _SWING * step_s + step_s
    forward_m = _steady(m, steady_s, length_m, length_m / step_s, end_s=steps[-1].stop_s + 2.0)
    ready = m.ease(BEGIN_S, start_s + step_s)
    # The standing foot's side, from mid-swing to mid-swing; arms go with the other leg.
    stance = m.keyframes([BEGIN_S, *(starts_s + _SWING / 2 * step_s)], [0, *-sides])
    ahead = m.keyframes([BEGIN_S + 0.05, *(starts_s + _SWING * step_s)], [0, *sides])
    rise = sum(m.bump(at_s - 0.1 * step_s, at_s + 0.9 * step_s) for at_s in starts_s)
    height_m = (0.022 * rise - 0.048 * ready) * size
    pelvis_m = m.axis(0.035 * stance * size, height_m, forward_m)
    pelvis_turn = m.axis(0.03 * ready, -0.09 * ahead, 0.03 * stance)
    spine = m.spine(0.03 * ready, 0.2 * ahead, -0.03 * stance)
    elbow = (0.3 - 0.15 * ahead, 0.3 + 0.15 * ahead)
    arms = m.arms(lower=1.3, swing=(-0.42 * ahead, 0.42 * ahead), elbow=elbow)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, m.feet(steps))


def turning(m: Planner) -> BodyPlan:
    """Turns round and round on the spot, one foot opening and the other one joining it."""
    step_s, side = 0.3 / m.tempo, m.leading_side
    start_s, turn = BEGIN_S + 0.25, side * np.deg2rad(58) * m.amplitude
    starts_s = m.starts_s(start_s, step_s)
    sides = m.sides(starts_s)
    step = partial(Step, lift_m=0.05 * m.size, take_off_pitch=0.35, pitch=0.3, landing_pitch=0.1)
    steps = [
        step(at_s, at_s + 0.85 * step_s, heading=turn * (row // 2 + 1), side=foot)
        for row, (foot, at_s) in enumerate(zip(sides, starts_s, strict=True))
    ]
    rate, steady_s = turn / (2 * step_s), start_s + 2 * step_s
    # At the end of a pair of steps the body faces a quarter of their turn beyond its feet.
    heading = _steady(m, steady_s, 1.05 * turn, rate, end_s=steps[-1].stop_s + 2.0)
    ready = m.ease(BEGIN_S, start_s + 0.3)
    stance = m.keyframes([BEGIN_S, *(starts_s + 0.4 * step_s)], [0, *-sides])
    sway_m, height_m = 0.045 * stance * m.size, -0.03 * ready * m.size
    pelvis_m = m.axis(sway_m * np.cos(heading), height_m, -sway_m * np.sin(heading))
    pelvis_turn = m.axis(0.02 * ready, 0.0, 0.02 * stance)
    spine = m.spine(0.03 * ready, 0.25 * side * ready, -0.02 * stance)
    arms = m.arms(lower=1.12 - 0.25 * ready, swing=(-0.15 * side * ready, 0.15 * side * ready))
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, m.feet(steps), heading=heading)


def quick_stops(m: Planner) -> BodyPlan:
    """Runs three quick steps, stops dead and stands perfectly still for a second, then again."""
    size, step_s = m.size, 0.22 / m.tempo
    length_m = 0.37 * size * m.amplitude
    run_s, still_s = 0.2 + 3.6 * step_s, 1.0
    bursts_s = m.starts_s(BEGIN_S, run_s + 0.3 + still_s)
    step = partial(Step, lift_m=0.09 * size, back_m=0.05 * size, pitch=0.6, landing_pitch=0.1)
    steps: list[Step] = []
    ahead, sink, lean, forward_m = (m.zeros() for _ in range(4))
    for burst, (at_s, lead) in enumerate(zip(bursts_s, m.sides(bursts_s), strict=True)):
        begin_m = 2 * length_m * burst
        starts_s = at_s + 0.15 + step_s * np.arange(3)
        sides = (lead, -lead, lead)
        # The last step brings the feet together.
        steps += [
            step(start_s, start_s + 0.9 * step_s, z_m=begin_m + steps_on * length_m, side=side)
            for side, start_s, steps_on in zip(sides, starts_s, (1.0, 2.0, 2.0), strict=True)
        ]
        stop_s, braking_s = starts_s[2] + 0.95 * step_s, starts_s[2] + 0.1 * step_s
        fast = (braking_s, 1.55 * length_m, 0.8 * length_m / step_s, 0.0)
        forward_m += m.track([(at_s, 0.0, 0.0, 0.0), fast, (stop_s, 2 * length_m, 0.0, 0.0)])
        knots_s = [at_s, *(starts_s + 0.8 * step_s), stop_s + 0.15]
        ahead += m.keyframes(knots_s, [0.0, *sides[:2], 0.4 * lead, 0.0])
        low_s = [at_s, at_s + 0.25, starts_s[2], stop_s, stop_s + 0.3]
        sink += m.keyframes(low_s, [0.0, 0.5, 0.5, 1.0, 0.0])
        lean += m.keyframes(low_s, [0.0, 1.0, 0.6, -0.5, 0.0])
    pelvis_m = m.axis(0.0, -0.08 * sink * size, forward_m)
    pelvis_turn = m.axis(0.14 * lean + 0.1 * sink, -0.08 * ahead, 0.0)
    spine = m.spine(0.1 * lean + 0.1 * sink, 0.2 * ahead)
    arms = m.arms(swing=(-0.6 * ahead, 0.6 * ahead), elbow=0.25 + 1.1 * sink)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, m.feet(steps))


def dancing(m: Planner) -> BodyPlan:
    """Steps to the side and together, to the other side and together, bouncing on each beat."""
    beat_s, size, lead = 0.42 / m.tempo, m.size, m.leading_side
    reach_m = 0.24 * size * m.amplitude
    start_s = BEGIN_S + 0.25
    starts_s = m.starts_s(start_s, beat_s)
    step = partial(Step, lift_m=0.05 * size, take_off_pitch=0.3, pitch=0.3, landing_pitch=0.15)
    # Out, together, back, together: the foot that goes and where both stand afterwards.
    pattern = itertools.cycle(((lead, 1.0), (-lead, 1.0), (-lead, 0.0), (lead, 0.0)))
    steps = [
        step(at_s, at_s + 0.7 * beat_s, x_m=lead * reach_m * share, side=side)
        for (side, share), at_s in zip(pattern, starts_s, strict=False)
    ]
    middles_m = lead * reach_m * np.resize([0.5, 1.0, 0.5, 0.0], len(starts_s))
    middle_m = m.keyframes([start_s - 0.1, *(starts_s + 0.75 * beat_s)], [0.0, *middles_m])
    depth = m.amplitude * m.ease(BEGIN_S, BEGIN_S + 0.8)
    phase = m.cycle(1 / beat_s, start_s)
    bounce = (1 - np.cos(phase)) / 2 * depth
    sway, groove = lead * np.sin(phase / 2) * depth, np.sin(phase / 4 + m.phase) * depth
    x_m, height_m = middle_m + 0.03 * sway * size, -(0.025 * depth + 0.045 * bounce) * size
    pelvis_m = m.axis(x_m, height_m, 0.02 * groove * size)
    pelvis_turn = m.axis(0.06 * bounce, -0.14 * sway, -0.1 * sway)
    spine = m.spine(0.08 * bounce, 0.22 * sway + 0.15 * groove, 0.12 * sway)
    arms = m.arms(
        lower=tuple(RELAXED_LOWER - (0.5 + share * groove) * depth for share in (0.55, -0.55)),
        swing=tuple((0.45 + share * np.sin(phase / 2)) * depth for share in (0.35, -0.35)),
        elbow=0.25 + (0.9 + 0.3 * np.cos(phase / 2)) * depth,
        shrug=(0.06 * sway, -0.06 * sway),
    )
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, m.feet(steps))
