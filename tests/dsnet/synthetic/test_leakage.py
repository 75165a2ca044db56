"""Nothing of a test take is in training: neither its name, nor its motion, nor its new person."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.distance import cdist

from bridge.body import load_body_model
from dsnet.synthetic.corpus_motions import CorpusMotions
from dsnet.synthetic.recordings import plan_of
from dsnet.synthetic.stage_corpus import PROFILES
from dsnet.synthetic.subjects import SUBJECTS, UNSEEN

# Half a second. In all takes alike everybody stands at first, and begins gently: what is compared
# with a tolerance comes later.
WINDOW, MOVING = 30, 40
SAME_RAD, ALIKE_RAD = 1e-5, 1e-3
both_genders = pytest.mark.parametrize("gender", ["female", "male"])


@cache
def motions_of(gender):
    return CorpusMotions(load_body_model(f"embedded:{gender}"), 0)


def windows(theta):
    """(N, 30 * 66) all windows; without the translation, so that none hides by standing apart."""
    view = sliding_window_view(theta[:, :66], WINDOW, axis=0)
    return view.reshape(len(view), -1)


def nearest_rad(thetas, others):
    """Root mean square distance of the two most similar windows."""
    found = (cdist(windows(one), windows(other)).min() for one in thetas for other in others)
    return min(found) / np.sqrt(WINDOW * 66)


@both_genders
@pytest.mark.parametrize("profile", PROFILES)
def test_no_test_take_new_person_or_unseen_kind_is_in_training(profile, gender):
    plan = plan_of(replace(PROFILES[profile], gender=gender))
    trained, tested = (
        [(take.subject.name, take.motion) for take in takes] for takes in (plan.dyna, plan.held_out)
    )
    assert len(set(tested)) == len(tested)
    assert set(trained).isdisjoint(tested)
    assert {take.name for take in plan.dyna}.isdisjoint(take.name for take in plan.held_out)
    assert {take.subject.name for take in plan.dyna} <= {s.name for s in SUBJECTS[gender]}
    assert {s.name for s in UNSEEN[gender]} & {take.subject.name for take in plan.held_out}
    shapes = np.array([take.subject.betas for take in plan.dyna])
    for subject in UNSEEN[gender]:
        assert np.linalg.norm(shapes - subject.betas, axis=1).min() > 0.5
    assert {take.kind for take in plan.dyna}.isdisjoint(PROFILES[profile].mosh_motions)


@both_genders
def test_no_window_of_a_test_motion_is_one_of_training(gender):
    plan = plan_of(replace(PROFILES["smoke"], gender=gender))
    trained = [motions_of(gender).procedural(take) for take in plan.dyna]
    tested = [motions_of(gender).as_read_back(take) for take in plan.held_out]
    assert nearest_rad(trained, [trained[0]]) == 0
    assert nearest_rad(tested, trained) > SAME_RAD
    assert nearest_rad([theta[MOVING:] for theta in tested], trained) > ALIKE_RAD


@both_genders
def test_a_known_persons_second_take_is_not_her_first(gender):
    """The likeliest leak, over all that `demo` trains the same person on."""
    plan = plan_of(replace(PROFILES["demo"], gender=gender))
    again = [take for take in plan.held_out if take.number == 2]
    assert len(again) == PROFILES["demo"].retakes
    for take in again:
        own = [motions_of(gender).procedural(t) for t in plan.dyna if t.subject == take.subject]
        again_theta = motions_of(gender).as_read_back(take)
        assert nearest_rad([again_theta], own) > SAME_RAD
        assert nearest_rad([again_theta[MOVING:]], own) > ALIKE_RAD


def test_unseen_kinds_are_far_from_all_that_the_same_person_trains_on():
    plan, person = plan_of(PROFILES["demo"]), SUBJECTS["female"][1]
    own = [motions_of("female").procedural(take) for take in plan.dyna if take.subject == person]
    unseen = [t for t in plan.held_out if t.subject == person and t.number == 1]
    assert len(unseen) >= 2
    for take in unseen:
        moving = motions_of("female").as_read_back(take)[MOVING:]
        assert nearest_rad([moving], own) > 10 * ALIKE_RAD
