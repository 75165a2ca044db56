"""Motions that leave the floor."""

from __future__ import annotations

import numpy as np

from torch_align_ae.corpus.motions.curves import axis, ease, keyframes
from torch_align_ae.corpus.motions.hops import Hops, HopTimes, plan_hops
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, FootPath, Style
from torch_align_ae.corpus.motions.postures import (
    RELAXED_LOWER,
    Swing,
    arm,
    arms,
    contacts_between,
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
    hops = _hops(times_s, style, 0.27, 0.27, 0.07, BEGIN_S, spread_sink_m=0.03 * style.size)
    wide = np.arange(len(hops.take_offs_s) + 1) % 2
    spread_m = 0.2 * style.size * style.amplitude
    left, right = (
        stepping_foot(times_s, hops.contacts(x_m=side * spread_m * wide), hops.swings(0.02))
        for side in (1, -1)
    )
    knots_s = np.stack([hops.take_offs_s - 0.08, hops.landings_s + 0.08], axis=1).ravel()
    opened = keyframes(times_s, knots_s, np.repeat(wide, 2)[1:-1].astype(float))
    return _upright(
        times_s,
        style,
        hops.height_m,
        feet=(left, right),
        joints=arms(
            times_s,
            lower=RELAXED_LOWER - opened * style.amplitude * 2.0,
            elbow=0.25 + 0.2 * opened * (1 - opened),
            shrug=0.25 * opened,
        ),
    )


def running_on_spot(times_s: Array, style: Style) -> BodyPlan:
    """Running without moving on."""
    contact_s = 0.24 / style.tempo
    hop = HopTimes(BEGIN_S, 0.115, contact_s, 0.035 * style.size, 0.04 * style.size, 0.04)
    hops = plan_hops(times_s, hop, style.rng())
    lead, other = _running_foot(times_s, hops, style, 0), _running_foot(times_s, hops, style, 1)
    middles_s = np.concatenate([hops.take_offs_s[:1] - 0.15, hops.landings_s + contact_s / 2])
    stance = style.leading_side * np.where(np.arange(len(middles_s)) % 2, -1.0, 1.0)
    stance[0] = 0.0
    side = keyframes(times_s, middles_s, stance)
    ready = ease(times_s, 0.1, BEGIN_S + 0.5)
    return _upright(
        times_s,
        style,
        hops.height_m,
        feet=(lead, other) if style.leading_side == 1 else (other, lead),
        joints={
            **trunk(times_s, bend=0.04 * ready, turn=-0.2 * side),
            **arm(times_s, "left", swing=0.6 * side - 0.1 * ready, elbow=0.25 + 1.2 * ready),
            **arm(times_s, "right", swing=-0.6 * side - 0.1 * ready, elbow=0.25 + 1.2 * ready),
        },
        x_m=0.035 * style.size * side,
        yaw=0.1 * side,
        roll=0.02 * side,
        lean=0.05 * ready,
    )


def _running_foot(times_s: Array, hops: Hops, style: Style, order: int) -> FootPath:
    """The foot that takes off first with the body (`order` 0), or the one that lands first."""
    take_offs_s, landings_s = hops.take_offs_s[order::2], hops.landings_s[1 - order :: 2]
    if order == 1:
        take_offs_s = np.concatenate([hops.take_offs_s[:1] - 0.2, take_offs_s])
    count = min(len(take_offs_s), len(landings_s))
    lift = Swing(
        lift_m=0.26 * style.size * style.amplitude,
        back_m=0.17 * style.size,
        take_off_pitch=0.6,
        pitch=0.9,
        landing_pitch=0.25,
        standing_pitch=0.05,
    )
    contacts = contacts_between(take_offs_s[:count], landings_s[:count])
    return stepping_foot(times_s, contacts, [lift] * count)


def side_to_side_hopping(times_s: Array, style: Style) -> BodyPlan:
    """Hops with both feet from one side to the other."""
    hops = _hops(times_s, style, 0.25, 0.29, 0.08, BEGIN_S)
    reach_m = 0.16 * style.size * style.amplitude
    places = (
        style.leading_side * reach_m * np.where(np.arange(len(hops.take_offs_s) + 1) % 2, 1, -1)
    )
    places[0] = 0.0
    foot = stepping_foot(times_s, hops.contacts(x_m=places), hops.swings(0.02))
    # The body starts before its feet and goes on after them, but not as far.
    knots_s = np.stack([hops.take_offs_s - 0.12, hops.landings_s + 0.12], axis=1).ravel()
    x_m = keyframes(times_s, knots_s, 0.9 * np.repeat(places, 2)[1:-1])
    tilt = (foot.ball_m[:, 0] - x_m) / (0.9 * style.size)
    return _upright(
        times_s,
        style,
        hops.height_m,
        feet=(foot, foot),
        joints={
            **trunk(times_s, roll=-0.8 * tilt),
            **arms(times_s, lower=0.95 - 0.8 * np.tanh(3 * hops.height_m) / 2, elbow=0.7),
        },
        x_m=x_m,
        roll=tilt,
    )


def _hops(
    times_s: Array,
    style: Style,
    flight_s: float,
    contact_s: float,
    crouch_m: float,
    begin_s: float,
    spread_sink_m: float = 0.0,
) -> Hops:
    hop = HopTimes(
        begin_s=begin_s,
        flight_s=flight_s * np.sqrt(style.amplitude),
        contact_s=contact_s / style.tempo,
        take_off_m=0.05 * style.size,
        crouch_m=crouch_m * style.size,
        spread_sink_m=spread_sink_m,
    )
    return plan_hops(times_s, hop, style.rng())


def _upright(
    times_s: Array,
    style: Style,
    height_m: Array,
    *,
    feet: tuple[FootPath, FootPath],
    joints: dict[str, Array],
    x_m: Array | float = 0.0,
    yaw: Array | float = 0.0,
    roll: Array | float = 0.0,
    lean: Array | float = 0.0,
) -> BodyPlan:
    """A body over the balls of its feet, which leans forwards as its knees bend."""
    over_balls = ease(times_s, BEGIN_S, BEGIN_S + 0.4)
    bend = -np.tanh(4 * height_m) / 4
    joints = trunk(times_s, bend=0.5 * bend) | joints
    return BodyPlan(
        pelvis_m=axis(times_s, x_m, height_m, 0.035 * style.size * over_balls - 0.25 * bend),
        pelvis_turn=axis(times_s, lean + 0.9 * bend, yaw, roll),
        left_foot=feet[0],
        right_foot=feet[1],
        joints=joints,
    )
