"""Motions that leave the floor: a countermovement, then ballistic flights and contacts in turn."""

from __future__ import annotations

from functools import partial

import numpy as np

from dsnet.synthetic.motions.plan import (
    BEGIN_S,
    GRAVITY_M_S2,
    RELAXED_LOWER,
    Array,
    BodyPlan,
    FootPath,
    Joints,
    Planner,
    Step,
    by_side,
)

_CROUCH_S = 0.36
_CROUCH_ACCELERATION_M_S2 = 5.0


def light_hopping_stiff(m: Planner) -> BodyPlan:
    """Small quick hops on stiff legs."""
    return _hopping(m, _Hops(m, 0.21 * np.sqrt(m.amplitude), 0.21, 0.05), arm_play=0.25)


def light_hopping_loose(m: Planner) -> BodyPlan:
    """Hops with loose knees and arms."""
    return _hopping(m, _Hops(m, 0.25 * np.sqrt(m.amplitude), 0.33, 0.1), arm_play=0.8)


def _hopping(m: Planner, hops: _Hops, arm_play: float) -> BodyPlan:
    foot = m.foot(hops.steps(0.01, standing_pitch=0.12))
    sway = np.sin(0.9 * m.times_s + m.phase) * m.ease(BEGIN_S, BEGIN_S + 1.5)
    arms = m.arms(
        lower=RELAXED_LOWER - arm_play * np.tanh(3 * hops.height_m) / 2,
        swing=0.06 * sway,
        elbow=0.35 - arm_play * np.tanh(3 * hops.height_m),
    )
    return hops.body((foot, foot), arms, yaw=0.08 * sway)


def one_leg_jump(m: Planner) -> BodyPlan:
    """Jumps on one leg, the other knee bent."""
    support, size = -m.leading_side, m.size
    hops = _Hops(m, 0.25 * np.sqrt(m.amplitude), 0.34, 0.08, begin_s=BEGIN_S + 0.12)
    raised = m.ease(BEGIN_S - 0.05, BEGIN_S + 0.45)
    height_m = hops.height_m
    lift_m = raised * (0.24 * size + 0.7 * height_m)
    front_m = -0.27 * size * raised - 0.2 * height_m * raised
    bent = FootPath(m.axis(-support * 0.02 * raised, lift_m, front_m), pitch=0.9 * raised)
    feet = by_side(support, m.foot(hops.steps(0.01)), bent)
    lower = RELAXED_LOWER - 0.35 * raised - 0.8 * np.tanh(3 * height_m) / 2
    arms = m.arms(lower=lower, elbow=0.6 - 0.8 * np.tanh(3 * height_m))
    x_m, roll = support * 0.105 * size * raised, -support * 0.05 * raised
    return hops.body(feet, arms, x_m=x_m, roll=roll)


def jumping_jacks(m: Planner) -> BodyPlan:
    """Jumps between closed and spread, arms swinging overhead."""
    hops = _Hops(m, 0.27 * np.sqrt(m.amplitude), 0.27, 0.07, spread_sink_m=0.03 * m.size)
    wide = np.arange(len(hops.take_offs_s) + 1) % 2
    spread_m = 0.2 * m.size * m.amplitude * wide[1:]
    left, right = (m.foot(hops.steps(0.02, side * spread_m)) for side in (1, -1))
    opened = m.keyframes(hops.around_s(0.08), np.repeat(wide, 2)[1:-1])
    lower, elbow = RELAXED_LOWER - opened * m.amplitude * 2.0, 0.25 + 0.2 * opened * (1 - opened)
    arms = m.arms(lower=lower, elbow=elbow, shrug=0.25 * opened)
    return hops.body((left, right), arms)


def running_on_spot(m: Planner) -> BodyPlan:
    """Running without moving on."""
    contact_s = 0.24
    hops = _Hops(m, 0.115, contact_s, 0.04, take_off_m=0.035, spread_sink_m=0.04)
    feet = by_side(m.leading_side, _running_foot(m, hops, 0), _running_foot(m, hops, 1))
    middles_s = [hops.take_offs_s[0] - 0.15, *(hops.landings_s + contact_s / m.tempo / 2)]
    stance = m.leading_side * np.where(np.arange(len(middles_s)) % 2, -1.0, 1.0)
    stance[0] = 0.0
    side = m.keyframes(middles_s, stance)
    ready = m.ease(0.1, BEGIN_S + 0.5)
    swing = (0.6 * side - 0.1 * ready, -0.6 * side - 0.1 * ready)
    arms = m.arms(swing=swing, elbow=0.25 + 1.2 * ready)
    spine = m.spine(0.04 * ready, -0.2 * side)
    x_m, yaw, roll, lean = 0.035 * m.size * side, 0.1 * side, 0.02 * side, 0.05 * ready
    return hops.body(feet, arms, spine, x_m=x_m, yaw=yaw, roll=roll, lean=lean)


def _running_foot(m: Planner, hops: _Hops, order: int) -> FootPath:
    """The foot that takes off first with the body (`order` 0), or the one that lands first."""
    take_offs_s, landings_s = hops.take_offs_s[order::2], hops.landings_s[1 - order :: 2]
    if order == 1:
        take_offs_s = np.concatenate([hops.take_offs_s[:1] - 0.2, take_offs_s])
    lift_m, back_m = 0.26 * m.size * m.amplitude, 0.17 * m.size
    lift = partial(
        Step, lift_m=lift_m, back_m=back_m, pitch=0.9, landing_pitch=0.25, standing_pitch=0.05
    )
    return m.foot([lift(*times_s) for times_s in zip(take_offs_s, landings_s, strict=False)])


def side_to_side_hopping(m: Planner) -> BodyPlan:
    """Hops with both feet from one side to the other."""
    hops = _Hops(m, 0.25 * np.sqrt(m.amplitude), 0.29, 0.08)
    odd = np.where(np.arange(len(hops.take_offs_s) + 1) % 2, 1, -1)
    places_m = m.leading_side * (0.16 * m.size * m.amplitude) * odd
    places_m[0] = 0.0
    foot = m.foot(hops.steps(0.02, places_m[1:]))
    # The body starts before its feet and goes on after them, but not as far.
    x_m = m.keyframes(hops.around_s(0.12), 0.9 * np.repeat(places_m, 2)[1:-1])
    tilt = (np.asarray(foot.ball_m)[:, 0] - x_m) / (0.9 * m.size)
    arms = m.arms(lower=0.95 - 0.8 * np.tanh(3 * hops.height_m) / 2, elbow=0.7)
    spine = m.spine(0.0, 0.0, -0.8 * tilt)
    return hops.body((foot, foot), arms, spine, x_m=x_m, roll=tilt)


def basketball_dribble_and_shoot(m: Planner) -> BodyPlan:
    """Dribbles a ball with bent knees and shoots it from a jump, again and again."""
    bounce_s, size, side = 0.5 / m.tempo, m.size, m.leading_side
    shots_s = np.arange(BEGIN_S + 0.6 + 3 * bounce_s, m.times_s[-1] + 2.0, 1.7 + 3 * bounce_s)
    variation = 1 + 0.04 * m.rng().uniform(-1, 1, len(shots_s))
    flights_s = 0.34 * np.sqrt(m.amplitude) * variation
    lifts_m = GRAVITY_M_S2 * flights_s**2 / 8 + 0.01
    foot = m.foot([Step(*row) for row in np.broadcast(shots_s, shots_s + flights_s, lifts_m)])
    ready = m.ease(BEGIN_S, BEGIN_S + 0.6)
    dribble, raised, flick = (m.zeros() for _ in range(3))
    # Height of the pelvis: bent knees, a deeper crouch before each jump, a soft landing.
    ready_m = -0.085 * size
    knots = [(BEGIN_S, 0.0, 0.0, 0.0), (BEGIN_S + 0.6, ready_m, 0.0, 0.0)]
    for shot_s, flight_s in zip(shots_s.tolist(), flights_s.tolist(), strict=True):
        raised += m.keyframes(shot_s + np.array([-0.5, 0.02, 0.55, 1.1]), [0, 1, 1, 0])
        flick += m.keyframes(shot_s + np.array([0.0, 0.2, 0.6, 1.0]), [0, 1, 1, 0])
        for bounce in range(3):
            start_s = shot_s - 0.55 - (3 - bounce) * bounce_s
            dribble += ready * m.bump(start_s, start_s + bounce_s)
        speed, landing_s = GRAVITY_M_S2 * flight_s / 2, shot_s + flight_s
        knots += [
            (shot_s - 0.65, ready_m, 0.0, 0.0),
            (shot_s - 0.27, -0.15 * size, 0.0, 5.0),
            (shot_s, 0.05 * size, speed, -GRAVITY_M_S2),
            (landing_s, 0.05 * size, -speed, -GRAVITY_M_S2),
            (landing_s + 0.22, -0.14 * size, 0.0, 6.0),
            (landing_s + 0.65, ready_m, 0.0, 0.0),
        ]
    height_m = m.track(knots)
    crouch = np.tanh(-4 * height_m) / 4
    dribbles = {
        "lower": RELAXED_LOWER + 0.1 * raised,
        "swing": 0.1 * ready + 0.25 * dribble + 1.35 * raised + 1.0 * flick,
        "elbow": 0.25 + 1.15 * ready - 0.95 * dribble + 0.4 * raised - 1.6 * flick,
    }
    helps = {
        "lower": RELAXED_LOWER - 0.25 * ready + 0.35 * raised,
        "swing": 0.2 * ready + 1.35 * raised + 0.6 * flick,
        "elbow": 0.25 + 0.75 * ready + 0.8 * raised - 0.9 * flick,
    }
    arms = m.arms(**{angle: by_side(side, dribbles[angle], helps[angle]) for angle in dribbles})
    pelvis_m = m.axis(0.0, height_m, 0.03 * size * ready - 0.3 * crouch)
    pelvis_turn = m.axis(1.2 * crouch, side * 0.05 * ready, 0.0)
    spine = m.spine(0.25 * ready * (1 - raised), -side * 0.1 * ready)
    return BodyPlan(pelvis_m, pelvis_turn, spine | arms, (foot, foot))


class _Hops:
    """Hops until after the last of the times, with the planner's tempo and size.

    Parameters
    ----------
    begin_s : when the countermovement begins; until then the body is still.
    flight_s, contact_s : means; each flight and contact differs by some 6 %.
    take_off_m : height of the pelvis above standing when the feet leave and meet the floor.
    crouch_m : depth of the countermovement below standing.
    spread_sink_m : how much lower the pelvis is in every second contact, when the legs are apart.
    """

    def __init__(
        self,
        m: Planner,
        flight_s: float,
        contact_s: float,
        crouch_m: float,
        *,
        begin_s: float = BEGIN_S,
        take_off_m: float = 0.05,
        spread_sink_m: float = 0.0,
    ) -> None:
        self._planner = m
        contact_s /= m.tempo
        crouch_m, take_off_m = crouch_m * m.size, take_off_m * m.size
        # More hops than fit into the time, independent of the frame rate.
        span_s = m.times_s[-1] + 0.01 - begin_s
        count = int(np.ceil(span_s / (0.7 * (flight_s + contact_s)))) + 1
        factors = 1 + 0.06 * np.clip(m.rng().standard_normal((count, 2)), -2, 2)
        flights_s, contacts_s = flight_s * factors[:, 0], contact_s * factors[:, 1]
        heights_m = take_off_m - spread_sink_m * (np.arange(count + 1) % 2)
        speeds = GRAVITY_M_S2 * flights_s / 2 + np.diff(heights_m) / flights_s
        crouch_s = begin_s + _CROUCH_S
        knots = [(begin_s, 0.0, 0.0, 0.0), (crouch_s, -crouch_m, 0.0, _CROUCH_ACCELERATION_M_S2)]
        first_s = crouch_s + _push_s(crouch_m + take_off_m, speeds[0])
        self.take_offs_s = np.cumsum([first_s, *(flights_s + contacts_s)[:-1]])
        self.landings_s = self.take_offs_s + flights_s
        falling = np.full(count, -GRAVITY_M_S2)
        up = np.stack([self.take_offs_s, heights_m[:-1], speeds, falling], 1)
        down = np.stack([self.landings_s, heights_m[1:], speeds + falling * flights_s, falling], 1)
        knots += np.stack([up, down], 1).reshape(-1, 4).tolist()
        self.height_m = m.track(knots)  # (T,) of the pelvis, above standing

    def around_s(self, margin_s: float) -> Array:
        """From before each take-off until after the landing, one flight after another."""
        flights = [self.take_offs_s - margin_s, self.landings_s + margin_s]
        return np.stack(flights, axis=1).ravel()

    def steps(self, tuck_m: float, x_m: Array | float = 0.0, **angles: float) -> list[Step]:
        """Steps of a foot in every hop, below the body: as high as the flight plus `tuck_m`.

        `x_m` may be the position of each landing.
        """
        lifts_m = GRAVITY_M_S2 * (self.landings_s - self.take_offs_s) ** 2 / 8 + tuck_m
        rows = np.broadcast(self.take_offs_s, self.landings_s, lifts_m, x_m)
        return [Step(*row, **angles) for row in rows]

    def body(
        self,
        feet: tuple[FootPath, FootPath],
        arms: Joints,
        spine: Joints | None = None,
        *,
        x_m: Array | float = 0.0,
        yaw: Array | float = 0.0,
        roll: Array | float = 0.0,
        lean: Array | float = 0.0,
    ) -> BodyPlan:
        """A body above the balls of its feet that leans forwards as its knees bend."""
        m = self._planner
        over_balls = m.ease(BEGIN_S, BEGIN_S + 0.4)
        bend = -np.tanh(4 * self.height_m) / 4
        pelvis_m = m.axis(x_m, self.height_m, 0.035 * m.size * over_balls - 0.25 * bend)
        pelvis_turn = m.axis(lean + 0.9 * bend, yaw, roll)
        return BodyPlan(pelvis_m, pelvis_turn, (spine or m.spine(0.5 * bend)) | arms, feet)


def _push_s(rise_m: float, speed_m_s: float) -> float:
    """Duration of the push from the crouch whose velocity is a cubic, so that none overshoots.

    Such a push rises by T v / 2 + T^2 (a0 - a1) / 12, with accelerations a0 and a1 at its ends.
    """
    curvature = (_CROUCH_ACCELERATION_M_S2 + GRAVITY_M_S2) / 12
    half = speed_m_s / 4
    return float((np.sqrt(half**2 + curvature * rise_m) - half) / curvature)
