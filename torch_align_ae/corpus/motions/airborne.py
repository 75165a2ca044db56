"""Motions that leave the floor."""

from __future__ import annotations

import numpy as np

from torch_align_ae.corpus.motions.curves import axis, ease, keyframes
from torch_align_ae.corpus.motions.hops import Hops, HopTimes, plan_hops
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, FootPath, Style
from torch_align_ae.corpus.motions.postures import (
    RELAXED_LOWER,
    Contact,
    Swing,
    arm,
    arms,
    stepping_foot,
    trunk,
)

BEGIN_S = 0.2


def light_hopping_stiff(times_s: Array, style: Style) -> BodyPlan:
    """Small quick hops on stiff legs."""
    return _hopping(times_s, style, flight_s=0.21, contact_s=0.21, crouch_m=0.05, arm_play=0.25)


def light_hopping_loose(times_s: Array, style: Style) -> BodyPlan:
    """Hops with loose knees and arms."""
    return _hopping(times_s, style, flight_s=0.25, contact_s=0.33, crouch_m=0.1, arm_play=0.8)


def _hopping(
    times_s: Array,
    style: Style,
    *,
    flight_s: float,
    contact_s: float,
    crouch_m: float,
    arm_play: float,
) -> BodyPlan:
    hops = _hops(times_s, style, flight_s, contact_s, crouch_m, BEGIN_S)
    swings = hops.swings(0.01, standing_pitch=0.12)
    foot = stepping_foot(times_s, hops.contacts(), swings)
    sway = np.sin(0.9 * times_s + style.phase) * ease(times_s, BEGIN_S, BEGIN_S + 1.5)
    return _upright(
        times_s,
        style,
        hops.height_m,
        feet=(foot, foot),
        joints=arms(
            times_s,
            lower=RELAXED_LOWER - arm_play * np.tanh(3 * hops.height_m) / 2,
            swing=0.06 * sway,
            elbow=0.35 - arm_play * np.tanh(3 * hops.height_m),
        ),
        yaw=0.08 * sway,
    )


def one_leg_jump(times_s: Array, style: Style) -> BodyPlan:
    """Jumps on one leg, the other knee bent."""
    support = -style.leading_side
    hops = _hops(times_s, style, 0.25, 0.34, 0.08, BEGIN_S + 0.12)
    raised = ease(times_s, BEGIN_S - 0.05, BEGIN_S + 0.45)
    height_m = hops.height_m
    planted = stepping_foot(times_s, hops.contacts(), hops.swings(0.01))
    bent = FootPath(
        axis(
            times_s,
            -support * 0.02 * raised,
            raised * (0.24 * style.size + 0.7 * height_m),
            -0.27 * style.size * raised - 0.2 * height_m * raised,
        ),
        pitch=0.9 * raised,
        yaw=np.zeros(times_s.shape),
    )
    balance = 0.35 * raised
    return _upright(
        times_s,
        style,
        height_m,
        feet=(planted, bent) if support == 1 else (bent, planted),
        joints=arms(
            times_s,
            lower=RELAXED_LOWER - balance - 0.8 * np.tanh(3 * height_m) / 2,
            elbow=0.6 - 0.8 * np.tanh(3 * height_m),
        ),
        x_m=support * 0.105 * style.size * raised,
        roll=-support * 0.05 * raised,
    )


def jumping_jacks(times_s: Array, style: Style) -> BodyPlan:
    """Jumps between closed and spread, arms swinging overhead."""
    hops = _hops(times_s, style, 0.27, 0.27, 0.07, BEGIN_S)
    wide = np.arange(len(hops.take_offs_s) + 1) % 2
    spread_m = 0.2 * style.size * style.amplitude
    feet = tuple(
        stepping_foot(times_s, hops.contacts(x_m=side * spread_m * wide), hops.swings(0.015))
        for side in (1, -1)
    )
    knots_s = np.stack([hops.take_offs_s - 0.08, hops.landings_s + 0.08], axis=1).ravel()
    opened = keyframes(times_s, knots_s, np.repeat(wide, 2)[1:-1].astype(float))
    drop_m = 0.028 * style.size * opened
    return _upright(
        times_s,
        style,
        hops.height_m - drop_m,
        feet=feet,
        joints=arms(
            times_s,
            lower=RELAXED_LOWER - opened * style.amplitude * 2.0,
            elbow=0.25 + 0.2 * opened * (1 - opened),
            shrug=0.25 * opened,
        ),
    )


def running_on_spot(times_s: Array, style: Style) -> BodyPlan:
    """Running without moving on, knees up."""
    flight_s, contact_s = 0.11 * style.amplitude, 0.24 / style.tempo
    hop = HopTimes(BEGIN_S, flight_s, contact_s, 0.035 * style.size, 0.04 * style.size, 0.04)
    hops = plan_hops(times_s, hop, style.rng())
    first = (1 - style.leading_side) // 2
    feet = tuple(_running_foot(times_s, hops, style, (index + first) % 2) for index in (0, 1))
    middles_s = np.concatenate([hops.take_offs_s[:1] - 0.15, hops.landings_s + contact_s / 2])
    stance = style.leading_side * np.where(np.arange(len(middles_s)) % 2, -1.0, 1.0)
    stance[0] = 0.0
    side = keyframes(times_s, middles_s, stance)
    return _upright(
        times_s,
        style,
        hops.height_m,
        feet=feet,
        joints={
            **trunk(times_s, bend=0.04, turn=-0.22 * side),
            **arm(times_s, "left", lower=1.15, swing=-0.1 + 0.6 * side, elbow=1.45),
            **arm(times_s, "right", lower=1.15, swing=-0.1 - 0.6 * side, elbow=1.45),
        },
        x_m=0.03 * style.size * side,
        yaw=0.1 * side,
        roll=0.02 * side,
        lean=0.05 * ease(times_s, BEGIN_S, BEGIN_S + 0.5),
        elbows_bent=ease(times_s, 0.05, BEGIN_S + 0.5),
    )
