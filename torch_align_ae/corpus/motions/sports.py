"""The held-out motions of a ball player."""

from __future__ import annotations

import numpy as np

from torch_align_ae.corpus.motions.curves import axis, bump, ease, keyframes, track
from torch_align_ae.corpus.motions.plan import GRAVITY_M_S2, Array, BodyPlan, FootPath, Style
from torch_align_ae.corpus.motions.postures import (
    RELAXED_LOWER,
    Swing,
    arm,
    contacts_between,
    standing_foot,
    stepping_foot,
    trunk,
)

BEGIN_S = 0.2
_FLIGHT_S = 0.34
_READY_M = -0.085


def basketball_dribble_and_shoot(times_s: Array, style: Style) -> BodyPlan:
    """Dribbles a ball with bent knees and shoots it from a jump, again and again."""
    bounce_s, size = 0.5 / style.tempo, style.size
    shots_s = np.arange(BEGIN_S + 0.6 + 3 * bounce_s, times_s[-1] + 2.0, 1.7 + 3 * bounce_s)
    flights_s = (
        _FLIGHT_S * np.sqrt(style.amplitude) * (1 + 0.04 * style.rng().uniform(-1, 1, len(shots_s)))
    )
    landings_s = shots_s + flights_s
    foot = stepping_foot(
        times_s,
        contacts_between(shots_s, landings_s),
        [Swing(GRAVITY_M_S2 * flight_s**2 / 8 + 0.01) for flight_s in flights_s.tolist()],
    )
    ready = ease(times_s, BEGIN_S, BEGIN_S + 0.6)
    dribble, raised, flick = (np.zeros(times_s.shape) for _ in range(3))
    for shot_s in shots_s.tolist():
        raised += keyframes(times_s, shot_s + np.array([-0.5, 0.02, 0.55, 1.1]), [0, 1, 1, 0])
        flick += keyframes(times_s, shot_s + np.array([0.0, 0.2, 0.6, 1.0]), [0, 1, 1, 0])
        for bounce in range(3):
            start_s = shot_s - 0.55 - (3 - bounce) * bounce_s
            dribble += ready * bump(times_s, start_s, start_s + bounce_s)
    height_m = track(times_s, _shot_knots(shots_s, flights_s, size))
    side = style.leading_side
    joints = trunk(times_s, bend=0.25 * ready * (1 - raised), turn=-side * 0.1 * ready)
    joints |= arm(
        times_s,
        "left" if side == 1 else "right",
        lower=RELAXED_LOWER + 0.1 * raised,
        swing=0.1 * ready + 0.25 * dribble + 1.35 * raised + 1.0 * flick,
        elbow=0.25 + 1.15 * ready - 0.95 * dribble + 0.4 * raised - 1.6 * flick,
    )
    joints |= arm(
        times_s,
        "right" if side == 1 else "left",
        lower=RELAXED_LOWER - 0.25 * ready + 0.35 * raised,
        swing=0.2 * ready + 1.35 * raised + 0.6 * flick,
        elbow=0.25 + 0.75 * ready + 0.8 * raised - 0.9 * flick,
    )
    crouch = np.tanh(-4 * height_m) / 4
    return BodyPlan(
        pelvis_m=axis(times_s, 0.0, height_m, 0.03 * size * ready - 0.3 * crouch),
        pelvis_turn=axis(times_s, 1.2 * crouch, side * 0.05 * ready, 0.0),
        left_foot=foot,
        right_foot=foot,
        joints=joints,
    )


def _shot_knots(
    shots_s: Array, flights_s: Array, size: float
) -> list[tuple[float, float, float, float]]:
    """Height of the pelvis: bent knees, a deeper crouch before each jump, a soft landing."""
    ready_m = _READY_M * size
    knots = [(BEGIN_S, 0.0, 0.0, 0.0), (BEGIN_S + 0.6, ready_m, 0.0, 0.0)]
    for shot_s, flight_s in zip(shots_s, flights_s, strict=True):
        speed, landing_s = GRAVITY_M_S2 * flight_s / 2, shot_s + flight_s
        knots += [
            (shot_s - 0.65, ready_m, 0.0, 0.0),
            (shot_s - 0.27, -0.15 * size, 0.0, 5.0),
            (shot_s, 0.05 * size, speed, -GRAVITY_M_S2),
            (landing_s, 0.05 * size, -speed, -GRAVITY_M_S2),
            (landing_s + 0.22, -0.14 * size, 0.0, 6.0),
            (landing_s + 0.65, ready_m, 0.0, 0.0),
        ]
    return knots


def kicking(times_s: Array, style: Style) -> BodyPlan:
    """Kicks to the front with one leg, the other stands."""
    support, size = -style.leading_side, style.size
    kick_s = 1.55 / style.tempo
    starts_s = np.arange(BEGIN_S + 0.35, times_s[-1] + 1.0, kick_s)
    variation = 1 + 0.05 * style.rng().standard_normal(len(starts_s))
    strength = np.minimum(style.amplitude * variation, 1.08)
    back, front, lift, cocked = (np.zeros(times_s.shape) for _ in range(4))
    for start_s, share in zip(starts_s.tolist(), strength.tolist(), strict=True):
        moments_s = start_s + np.array([0.0, 0.38, 0.54, 0.72, 1.25]) / style.tempo
        back += keyframes(times_s, moments_s[[0, 1, 3]], [0.0, 1.0, 0.0])
        front += share * keyframes(times_s, moments_s[[1, 3, 4]], [0.0, 1.0, 0.0])
        lift += keyframes(times_s, moments_s, [0.0, 0.22, 0.12, 0.40 * share, 0.0])
        cocked += keyframes(times_s, moments_s[[0, 1, 3, 4]], [0.0, 0.9, 0.45, 0.0])
    kicker = FootPath(
        axis(times_s, -support * 0.03 * front, lift, -0.38 * back + 0.62 * front) * size,
        pitch=cocked,
        yaw=np.zeros(times_s.shape),
    )
    raised = ease(times_s, BEGIN_S, BEGIN_S + 0.4)
    turn = support * 0.3 * (front - back)
    planted = standing_foot(times_s)
    swing = support * 0.6 * (front - 0.7 * back)
    return BodyPlan(
        pelvis_m=axis(times_s, support * 0.1 * raised, -0.025 * raised, 0.03 * back + 0.02 * front)
        * size,
        pelvis_turn=axis(times_s, 0.12 * back - 0.14 * front, 0.6 * turn, -support * 0.05 * raised),
        left_foot=planted if support == 1 else kicker,
        right_foot=kicker if support == 1 else planted,
        joints={
            **trunk(times_s, bend=0.22 * front, turn=-1.1 * turn, roll=support * 0.06 * raised),
            **arm(times_s, "left", lower=RELAXED_LOWER - 0.3 * raised, swing=-swing, elbow=0.4),
            **arm(times_s, "right", lower=RELAXED_LOWER - 0.3 * raised, swing=swing, elbow=0.4),
        },
    )
