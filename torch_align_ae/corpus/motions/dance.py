"""A held-out dance: side steps on the beat, hips, shoulders and arms with them."""

from __future__ import annotations

import numpy as np

from torch_align_ae.corpus.motions.curves import axis, cycle, ease, keyframes
from torch_align_ae.corpus.motions.locomotion import Step, feet_of_steps
from torch_align_ae.corpus.motions.plan import Array, BodyPlan, Style
from torch_align_ae.corpus.motions.postures import RELAXED_LOWER, Swing, arm, trunk

BEGIN_S = 0.2


def dancing(times_s: Array, style: Style) -> BodyPlan:
    """Steps to the side and together, to the other side and together, bouncing on each beat."""
    beat_s, size, lead = 0.42 / style.tempo, style.size, style.leading_side
    reach_m = 0.24 * size * style.amplitude
    start_s = BEGIN_S + 0.25
    starts_s = np.arange(start_s, times_s[-1] + 1.0, beat_s)
    # Out, together, back, together: the foot that goes and where both stand afterwards.
    pattern = ((lead, 1.0), (-lead, 1.0), (-lead, 0.0), (lead, 0.0))
    steps = [
        Step(
            pattern[index % 4][0],
            at_s,
            at_s + 0.7 * beat_s,
            x_m=lead * reach_m * pattern[index % 4][1],
        )
        for index, at_s in enumerate(starts_s.tolist())
    ]
    swing = Swing(0.05 * size, take_off_pitch=0.3, pitch=0.3, landing_pitch=0.15)
    feet = feet_of_steps(times_s, steps, swing)
    middle_m = keyframes(
        times_s,
        np.concatenate([[start_s - 0.1], starts_s + 0.75 * beat_s]),
        np.concatenate([[0.0], lead * reach_m * np.resize([0.5, 1.0, 0.5, 0.0], len(starts_s))]),
    )
    depth = style.amplitude * ease(times_s, BEGIN_S, BEGIN_S + 0.8)
    phase = cycle(times_s, 1 / beat_s, start_s)
    bounce = (1 - np.cos(phase)) / 2 * depth
    sway, groove = lead * np.sin(phase / 2) * depth, np.sin(phase / 4 + style.phase) * depth
    joints = trunk(times_s, bend=0.08 * bounce, turn=0.22 * sway + 0.15 * groove, roll=0.12 * sway)
    for name, side in (("left", 1), ("right", -1)):
        wave = side * groove
        joints |= arm(
            times_s,
            name,
            lower=RELAXED_LOWER - (0.5 + 0.55 * wave) * depth,
            swing=(0.45 + 0.35 * side * np.sin(phase / 2)) * depth,
            elbow=0.25 + (0.9 + 0.3 * np.cos(phase / 2)) * depth,
            shrug=0.06 * side * sway,
        )
    return BodyPlan(
        pelvis_m=axis(times_s, middle_m + 0.03 * sway * size, 0.0, 0.0)
        + axis(times_s, y=-(0.025 * depth + 0.045 * bounce) * size, z=0.02 * groove * size),
        pelvis_turn=axis(times_s, 0.06 * bounce, -0.14 * sway, -0.1 * sway),
        left_foot=feet[1],
        right_foot=feet[-1],
        joints=joints,
    )
