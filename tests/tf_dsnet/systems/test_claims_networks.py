"""The study of claims: what a probe finds, and what somebody else's betas cost."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.claims.data import Reference, ScoredMotion
from benchmarks.claims.networks import _exchanged, _probe

RNG = np.random.default_rng(0)


def motions(count: int, frames: int = 60) -> list[np.ndarray]:
    return [RNG.normal(size=(frames, 69)).cumsum(axis=0) for _ in range(count)]


def test_a_probe_finds_velocities_where_they_are_and_nowhere_else() -> None:
    fitted, judged = motions(6), motions(2)

    def told(theta: np.ndarray) -> np.ndarray:
        return np.concatenate([theta, np.diff(theta, axis=0, prepend=theta[:1])], axis=1)

    def r2(features) -> float:
        return _probe([(features(t), t) for t in fitted], [(features(t), t) for t in judged], 1)

    assert r2(told) > 0.95
    assert r2(lambda theta: theta) < 0.1


def scored(name: str, cell: str, person: int) -> ScoredMotion:
    codes = np.full((5, 100), 1.0 + person)
    squares = np.square(codes).sum(axis=1)
    betas = np.full(10, float(person))
    return ScoredMotion(
        name, cell, np.zeros((5, 69)), betas, Reference(codes, 0 * squares, squares)
    )


def test_other_betas_cost_what_the_predictor_makes_of_them() -> None:
    known = "known_person_known_motion"
    those = [
        scored("a_hips", known, 0),
        scored("b_hips", known, 1),
        scored("a_jump", "validation", 0),
        scored("n_hips", "new_person_known_motion", 3),
    ]
    found = _exchanged(lambda theta, betas: np.full((5, 100), 1.0 + betas[0]), those)
    assert found[known]["own"] == 1.0
    # Each is off by 1 where the sizes are 1 and 2.
    assert found[known]["other"] == pytest.approx(1 - 2 / 5)
    assert found["validation"]["other"] == pytest.approx(0.0)
    deaf = _exchanged(lambda theta, betas: np.full((5, 100), 1.5), those)
    assert deaf[known]["difference"] == 0.0
    assert deaf[known]["own"] == deaf[known]["other"]
