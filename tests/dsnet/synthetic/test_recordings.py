from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.posing import shaped_vertices
from bridge.errors import DsnetError
from bridge.motion import MotionSequence
from bridge.motion.splits import CELLS, cell_of
from dsnet.synthetic.motions import DYNA_MOTIONS
from dsnet.synthetic.recordings import CorpusConfig, plan_of
from dsnet.synthetic.stage_corpus import PROFILES
from dsnet.synthetic.subjects import SUBJECTS, UNSEEN, Gender


@pytest.mark.parametrize(("gender", "sequences"), [("female", 67), ("male", 66)])
def test_the_full_corpus_has_the_papers_sequences(gender, sequences):
    takes = plan_of(CorpusConfig(gender=gender, mean_frames=60)).dyna  # which is ignored
    assert len({take.name for take in takes}) == len(takes) == sequences
    lengths = np.array([take.frame_count for take in takes])
    assert lengths.min() >= 2 * 60
    assert lengths.max() <= 15 * 60
    assert ((lengths >= 200) & (lengths <= 400)).mean() > 0.75


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_full_female_corpus_has_the_papers_frames(seed):
    takes = plan_of(CorpusConfig(seed=seed)).dyna
    assert sum(take.frame_count for take in takes) == 21_502


@pytest.mark.parametrize("profile", PROFILES)
def test_every_profile_validates_on_one_subject_what_others_train_on(profile):
    config = PROFILES[profile]
    takes = plan_of(config).dyna
    jumpers = [take.subject.name for take in takes if take.motion == "one_leg_jump"]
    assert len(jumpers) == config.subjects
    assert "50004" in jumpers


def held_out(unseen=("kicking",), retakes=1):
    asked = CorpusConfig(
        motions=("hips",), mosh_motions=unseen, mosh_seconds=2.0, retakes=retakes, crossing="full"
    )
    return plan_of(asked).held_out


def cells(takes, gender: Gender = "female"):
    people = {subject.name for subject in SUBJECTS[gender]}
    found = [
        MotionSequence(take.name, take.subject.name, take.motion, 0, take.frame_count, 60.0, "test")
        for take in takes
    ]
    return Counter(cell_of(sequence, people, set(DYNA_MOTIONS)) for sequence in found)


def test_full_crossing_is_two_known_people_and_all_new_ones():
    assert {take.name for take in held_out()} == {
        *("50004_kicking", "50020_kicking", "99001_kicking", "99003_kicking", "99005_kicking"),
        *("50004_hips_take2", "50020_hips_take2", "99001_hips", "99003_hips", "99005_hips"),
    }
    assert cells(held_out()) == dict(zip(CELLS, (2, 2, 3, 3), strict=True))


@pytest.mark.parametrize("gender", ["female", "male"])
def test_demo_crosses_each_kind_with_one_known_and_one_new_person_in_rotation(gender):
    takes = plan_of(replace(PROFILES["demo"], gender=gender)).held_out
    assert cells(takes, gender) == dict(zip(CELLS, (3, 11, 3, 11), strict=True))
    assert len({take.name for take in takes}) == len(takes)
    by_person = Counter(take.subject.name for take in takes)
    names = [subject.name for subject in (*SUBJECTS[gender], *UNSEEN[gender])]
    assert list(by_person) == names
    assert max(by_person.values()) - min(by_person.values()) <= 3


def test_smoke_has_one_take_a_cell_and_paper_the_papers_thirty():
    assert set(cells(plan_of(PROFILES["smoke"]).held_out).values()) == {1}
    paper = cells(plan_of(PROFILES["paper"]).held_out)
    assert paper == dict(zip(CELLS, (4, 11, 4, 11), strict=True))


def test_lying_down_takes_the_time_that_it_needs():
    lengths = {"lying_down_and_getting_up": 561, "walking": 201}
    assert {take.kind: take.frame_count for take in held_out([*lengths], retakes=0)} == lengths


def test_more_retakes_than_motions_are_all_motions():
    config = replace(PROFILES["smoke"], retakes=9, mosh_motions=())
    kinds = {take.kind for take in plan_of(config).held_out}
    assert kinds == {"one_leg_jump", "hips"}
    assert plan_of(replace(config, retakes=0)).held_out == []


@pytest.mark.parametrize("gender", ["female", "male"])
def test_people_differ_from_lean_to_heavy_and_the_new_ones_are_among_them(gender):
    people, new = SUBJECTS[gender], UNSEEN[gender]
    assert len({person.name for person in (*people, *new)}) == 8
    known = np.array([person.betas for person in people])
    for person in new:
        assert np.linalg.norm(known - person.betas, axis=1).min() > 0.8
        assert (np.abs(person.betas) <= np.abs(known).max()).all()
    weights = [litres(gender, person) for person in new]
    assert weights[1] > weights[0] > weights[2]
    everybody = [litres(gender, person) for person in people]
    assert max(everybody) > 1.35 * min(everybody)
    assert np.diff(np.sort(everybody)).min() > 1.0
    assert min(everybody) - 1 < min(weights)
    assert max(weights) < max(everybody)


def litres(gender, subject):
    data = load_body_model(f"embedded:{gender}")
    corners = shaped_vertices(data, subject.betas[None])[0][data.faces]
    return np.linalg.det(corners).sum() / 6 * 1000


@pytest.mark.parametrize(
    ("motions", "unseen", "complaint"),
    [
        (("waltz",), (), "motions waltz"),
        ((), (), "no motions"),
        (("hips", "knees", "hips"), (), "motions hips more than once"),
        (("hips",), ("kicking", "kicking"), "motions kicking more than once"),
        (("hips",), ("hips",), "motions hips"),
    ],
)
def test_motions_that_there_are_not_or_twice_are_refused(motions, unseen, complaint):
    with pytest.raises(DsnetError, match=complaint):
        plan_of(CorpusConfig(motions=motions, mosh_motions=unseen))


@pytest.mark.parametrize("profile", PROFILES)
def test_the_page_counts_each_profiles_takes(profile):
    plan = plan_of(PROFILES[profile])
    page = (Path(__file__).parents[3] / "docs" / "data.md").read_text()
    row = next(line for line in page.splitlines() if line.startswith(f"| `{profile}` |"))
    trained = sum(take.frame_count for take in plan.dyna)
    # A reader resamples a held-out file from 100 to 60 fps.
    tested = sum(int((take.frame_count - 1) * 0.6 + 1e-9) + 1 for take in plan.held_out)
    assert f"{len(plan.dyna)} takes, {trained:,} frames" in row
    assert f"{len(plan.held_out)} takes, {tested:,} frames" in row
