"""Held-out motions that go somewhere: walking, turning on the spot, runs that stop dead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torch_align_ae.corpus.motions.curves import axis, bump, ease, keyframes, track
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, FootPath, Style
from torch_align_ae.corpus.motions.postures import Contact, Swing, arm, stepping_foot, trunk

BEGIN_S = 0.2
# Share of a step in which its foot is in the air; in the rest both feet carry.
_SWING = 0.8


@dataclass(frozen=True)
class Step:
    """One step: which foot goes where and when."""

    side: int
    """+1 for the left foot, -1 for the right."""
    start_s: float
    """The foot leaves the floor."""
    stop_s: float
    """It lands."""
    x_m: float = 0.0
    """Displacement from its first place, to the body's first left."""
    z_m: float = 0.0
    """To its first front."""
    heading: float = 0.0
    """Turn of its place and of the foot, radians to the left."""


def feet_of_steps(times_s: Array, steps: list[Step], swing: Swing) -> dict[int, FootPath]:
    """Both feet's paths, by side, through `steps` in order of time."""
    feet = {}
    for side in (1, -1):
        own = [step for step in steps if step.side == side]
        starts = [-1.0, *(step.stop_s for step in own)]
        stops = [*(step.start_s for step in own), np.inf]
        places = [(0.0, 0.0), *((step.x_m, step.z_m) for step in own)]
        contacts = [
            Contact(start, stop, *place)
            for start, stop, place in zip(starts, stops, places, strict=True)
        ]
        path = stepping_foot(times_s, contacts, [swing] * len(own))
        heading, before = np.zeros(times_s.shape), 0.0
        for step in own:
            heading += (step.heading - before) * ease(times_s, step.start_s, step.stop_s)
            before = step.heading
        feet[side] = FootPath(path.ball_m, path.pitch, path.yaw, heading)
    return feet


def walking(times_s: Array, style: Style) -> BodyPlan:
    """Walks straight ahead."""
    step_s, size = 0.5 / style.tempo, style.size
    length_m = 0.55 * size * style.amplitude
    start_s = BEGIN_S + 0.25
    starts_s = np.arange(start_s, times_s[-1] + 1.0, step_s)
    sides = style.leading_side * (-1) ** np.arange(len(starts_s))
    # The first step is half as long, so that afterwards the body is always between its feet.
    steps = [
        Step(side, at_s, at_s + _SWING * step_s, z_m=(index + 0.5) * length_m)
        for index, (side, at_s) in enumerate(zip(sides.tolist(), starts_s.tolist(), strict=True))
    ]
    swing = Swing(
        0.07 * size, take_off_pitch=0.75, pitch=0.45, landing_pitch=0.02, standing_pitch=0.0
    )
    feet = feet_of_steps(times_s, steps, swing)
    speed = length_m / step_s
    steady_s = start_s + _SWING * step_s + step_s
    end_s = steps[-1].stop_s + 2.0
    forward_m = track(
        times_s,
        [
            (BEGIN_S, 0.0, 0.0, 0.0),
            (steady_s, length_m, speed, 0.0),
            (end_s, length_m + speed * (end_s - steady_s), speed, 0.0),
        ],
    )
    ready = ease(times_s, BEGIN_S, start_s + step_s)
    # The standing foot's side, from mid-swing to mid-swing; arms go with the other leg.
    middles_s = np.concatenate([[BEGIN_S], starts_s + _SWING / 2 * step_s])
    stance = keyframes(times_s, middles_s, np.concatenate([[0.0], -sides.astype(float)]))
    landings_s = np.concatenate([[BEGIN_S + 0.05], starts_s + _SWING * step_s])
    ahead = keyframes(times_s, landings_s, np.concatenate([[0.0], sides.astype(float)]))
    rise = np.zeros(times_s.shape)
    for at_s in starts_s.tolist():
        rise += bump(times_s, at_s - 0.1 * step_s, at_s + 0.9 * step_s)
    return BodyPlan(
        pelvis_m=axis(times_s, 0.035 * stance * size, (0.022 * rise - 0.048 * ready) * size, 0.0)
        + axis(times_s, z=forward_m),
        pelvis_turn=axis(times_s, 0.03 * ready, -0.09 * ahead, 0.03 * stance),
        left_foot=feet[1],
        right_foot=feet[-1],
        joints={
            **trunk(times_s, bend=0.03 * ready, turn=0.2 * ahead, roll=-0.03 * stance),
            **arm(times_s, "left", lower=1.3, swing=-0.42 * ahead, elbow=0.3 - 0.15 * ahead),
            **arm(times_s, "right", lower=1.3, swing=0.42 * ahead, elbow=0.3 + 0.15 * ahead),
        },
    )


def turning(times_s: Array, style: Style) -> BodyPlan:
    """Turns round and round on the spot, one foot opening and the other one joining it."""
    step_s, size, side = 0.3 / style.tempo, style.size, style.leading_side
    start_s, turn = BEGIN_S + 0.25, side * np.deg2rad(58) * style.amplitude
    starts_s = np.arange(start_s, times_s[-1] + 1.0, step_s).tolist()
    steps = [
        Step(
            side * (-1) ** index,
            at_s,
            at_s + 0.85 * step_s,
            heading=turn * (index // 2 + 1),
        )
        for index, at_s in enumerate(starts_s)
    ]
    swing = Swing(0.05 * size, take_off_pitch=0.35, pitch=0.3, landing_pitch=0.1)
    feet = feet_of_steps(times_s, steps, swing)
    rate, steady_s = turn / (2 * step_s), start_s + 2 * step_s
    end_s = steps[-1].stop_s + 2.0
    # At the end of a pair of steps the body faces a quarter of their turn beyond its feet.
    heading = track(
        times_s,
        [
            (BEGIN_S, 0.0, 0.0, 0.0),
            (steady_s, 1.05 * turn, rate, 0.0),
            (end_s, 1.05 * turn + rate * (end_s - steady_s), rate, 0.0),
        ],
    )
    ready = ease(times_s, BEGIN_S, start_s + 0.3)
    standing = -np.array([step.side for step in steps], float)
    knots_s = np.concatenate([[BEGIN_S], np.array(starts_s) + 0.4 * step_s])
    stance = keyframes(times_s, knots_s, np.concatenate([[0.0], standing]))
    sway_m = 0.045 * stance * size
    return BodyPlan(
        pelvis_m=axis(
            times_s, sway_m * np.cos(heading), -0.03 * ready * size, -sway_m * np.sin(heading)
        ),
        pelvis_turn=axis(times_s, 0.02 * ready, 0.0, 0.02 * stance),
        left_foot=feet[1],
        right_foot=feet[-1],
        joints={
            **trunk(times_s, bend=0.03 * ready, turn=0.25 * side * ready, roll=-0.02 * stance),
            **arm(times_s, "left", lower=1.12 - 0.25 * ready, swing=-0.15 * side * ready),
            **arm(times_s, "right", lower=1.12 - 0.25 * ready, swing=0.15 * side * ready),
        },
        heading=heading,
    )


def quick_stops(times_s: Array, style: Style) -> BodyPlan:
    """Runs three quick steps, stops dead and stands perfectly still for a second, then again."""
    size, step_s = style.size, 0.22 / style.tempo
    length_m = 0.37 * size * style.amplitude
    run_s, still_s = 0.2 + 3.6 * step_s, 1.0
    bursts_s = np.arange(BEGIN_S, times_s[-1] + 1.0, run_s + 0.3 + still_s).tolist()
    steps: list[Step] = []
    ahead, sink, lean, forward_m = (np.zeros(times_s.shape) for _ in range(4))
    for burst, at_s in enumerate(bursts_s):
        begin_m, first_s = 2 * length_m * burst, at_s + 0.15
        lead = style.leading_side * (-1) ** burst
        starts_s = first_s + step_s * np.arange(3)
        sides = np.array([lead, -lead, lead])
        # The last step brings the feet together.
        for side, start_s, steps_on in zip(
            sides.tolist(), starts_s.tolist(), (1.0, 2.0, 2.0), strict=True
        ):
            place_m = begin_m + steps_on * length_m
            steps.append(Step(side, start_s, start_s + 0.9 * step_s, z_m=place_m))
        stop_s = starts_s[2] + 0.95 * step_s
        forward_m += track(
            times_s,
            [
                (at_s, 0.0, 0.0, 0.0),
                (starts_s[2] + 0.1 * step_s, 1.55 * length_m, 0.8 * length_m / step_s, 0.0),
                (stop_s, 2 * length_m, 0.0, 0.0),
            ],
        )
        knots_s = np.array([at_s, *(starts_s + 0.8 * step_s), stop_s + 0.15])
        ahead += keyframes(times_s, knots_s, [0.0, *sides[:2].tolist(), 0.4 * lead, 0.0])
        low_s = np.array([at_s, at_s + 0.25, starts_s[2], stop_s, stop_s + 0.3])
        sink += keyframes(times_s, low_s, [0.0, 0.5, 0.5, 1.0, 0.0])
        lean += keyframes(times_s, low_s, [0.0, 1.0, 0.6, -0.5, 0.0])
    swing = Swing(0.09 * size, back_m=0.05 * size, take_off_pitch=0.6, pitch=0.6, landing_pitch=0.1)
    feet = feet_of_steps(times_s, steps, swing)
    return BodyPlan(
        pelvis_m=axis(times_s, 0.0, -0.08 * sink * size, forward_m),
        pelvis_turn=axis(times_s, 0.14 * lean + 0.1 * sink, -0.08 * ahead, 0.0),
        left_foot=feet[1],
        right_foot=feet[-1],
        joints={
            **trunk(times_s, bend=0.1 * lean + 0.1 * sink, turn=0.2 * ahead),
            **arm(times_s, "left", swing=-0.6 * ahead, elbow=0.25 + 1.1 * sink),
            **arm(times_s, "right", swing=0.6 * ahead, elbow=0.25 + 1.1 * sink),
        },
    )
