"""The static part: found where it is, and only there; left-out motions decide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.body import BodyModelData
from bridge.tissue.node_clips import NodeClip
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.static_part import fit_static
from tests.forged.oscillating import MOTIONS, clips_of, people_of, true_model

NODES, PEOPLE = 60, 3


@pytest.fixture(scope="module")
def clips(body: BodyModelData) -> list[NodeClip]:
    nodes = TissueNodes.of(body, NODES)
    return clips_of(body, true_model(nodes, people_of(PEOPLE)), frames=120)


def moving(clips: list[NodeClip]) -> list[np.ndarray]:
    """What a perfect model of the dynamics says."""
    return [clip.offsets_m for clip in clips]


def shifted(clips: list[NodeClip], by) -> list[NodeClip]:
    return [replace(c, offsets_m=(c.offsets_m + by(c)).astype(np.float32)) for c in clips]


def noisy(clips: list[NodeClip]) -> list[NodeClip]:
    rng = np.random.default_rng(0)
    return shifted(clips, lambda c: rng.normal(scale=1e-3, size=c.offsets_m.shape))


def test_offsets_that_loads_explain_have_none(clips):
    found = fit_static(noisy(clips), moving(clips), PEOPLE)
    assert found.kind == "none"
    assert not found.constant_m.any()
    assert not found.by_pose_m.any()


def test_constants_of_each_person_are_found(clips):
    planted = np.random.default_rng(1).normal(scale=3e-3, size=(PEOPLE, NODES, 3))
    misfit = shifted(noisy(clips), lambda c: planted[c.person])
    found = fit_static(misfit, moving(clips), PEOPLE)
    assert found.kind == "constant"
    missed = np.linalg.norm(found.constant_m - planted) / np.linalg.norm(planted)
    assert missed < 0.1
    assert not found.by_pose_m.any()
    np.testing.assert_allclose(found.of(clips[4])[7], found.constant_m[clips[4].person])


def test_misfit_by_pose_is_found_and_carries_over_to_other_motions(clips):
    rng = np.random.default_rng(2)
    planted = np.zeros((207, NODES, 3))
    planted[rng.permutation(207)[:12]] = rng.normal(scale=0.02, size=(12, NODES, 3))
    constant = rng.normal(scale=3e-3, size=(PEOPLE, NODES, 3))

    def static(clip: NodeClip) -> np.ndarray:
        return constant[clip.person] + np.tensordot(clip.features, planted, 1)

    misfit = shifted(noisy(clips), static)
    seen = [c for c in misfit if c.sequence.motion != MOTIONS[-1]]
    unseen = [c for c in misfit if c.sequence.motion == MOTIONS[-1]]
    truth = {c.sequence.name: clip.offsets_m for c, clip in zip(misfit, clips, strict=True)}
    found = fit_static(seen, [truth[c.sequence.name] for c in seen], PEOPLE)
    assert found.kind == "pose"
    left = sum(np.square(found.of(c) - static(c)).sum() for c in unseen)
    whole = sum(np.square(static(c)).sum() for c in unseen)
    assert left < 0.2 * whole


def test_what_only_one_kind_of_motion_has_is_not_taken_for_static(clips):
    """It would be predicted of every other motion in that pose."""
    rng = np.random.default_rng(3)
    of_kind = {kind: rng.normal(scale=0.05, size=(207, NODES, 3)) for kind in MOTIONS}
    misfit = shifted(clips, lambda c: np.tensordot(c.features, of_kind[c.sequence.motion], 1))
    found = fit_static(misfit, moving(clips), PEOPLE)
    assert not found.by_pose_m.any()


def test_takes_of_one_motion_are_one_kind(clips):
    """Left out together: else a fit would be judged on what it was made from."""
    renamed = [
        replace(c, sequence=replace(c.sequence, motion=f"hips_take{1 + i}"))
        for i, c in enumerate(clips)
    ]
    planted = np.full((NODES, 3), 5e-3)
    found = fit_static(shifted(renamed, lambda c: planted), moving(clips), PEOPLE)
    assert found.kind == "none"
