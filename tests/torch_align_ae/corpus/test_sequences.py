from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.posing import shaped_vertices
from bridge.errors import DsnetError
from torch_align_ae.corpus.motions import DYNA_MOTIONS
from torch_align_ae.corpus.sequences import dyna_takes, mosh_takes
from torch_align_ae.corpus.stage_corpus import PROFILES
from torch_align_ae.corpus.subjects import SUBJECTS, UNSEEN


@pytest.mark.parametrize(("gender", "sequences"), [("female", 67), ("male", 66)])
def test_the_full_corpus_has_the_papers_sequences(gender, sequences):
    takes = dyna_takes(gender, 5, tuple(DYNA_MOTIONS), 0, seed=0)
    assert len({take.name for take in takes}) == len(takes) == sequences
    lengths = np.array([take.frame_count for take in takes])
    assert lengths.min() >= 2 * 60
    assert lengths.max() <= 15 * 60
    assert ((lengths >= 200) & (lengths <= 400)).mean() > 0.75


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_full_female_corpus_has_the_papers_frames(seed):
    takes = dyna_takes("female", 5, tuple(DYNA_MOTIONS), 0, seed)
    assert sum(take.frame_count for take in takes) == 21_502


@pytest.mark.parametrize("profile", PROFILES)
def test_every_profile_validates_on_one_subject_what_others_train_on(profile):
    config = PROFILES[profile]
    takes = dyna_takes("female", config.subjects, config.motions, config.mean_frames, 0)
    jumpers = [take.subject.name for take in takes if take.motion == "one_leg_jump"]
    assert len(jumpers) == config.subjects
    assert "50004" in jumpers


def test_mosh_takes_include_a_body_that_no_dyna_sequence_has():
    known = {subject.name for subject in SUBJECTS["female"]}
    found = {take.subject.name for take in mosh_takes("female", 5, ("kicking",), 2.0)}
    assert found - known == {UNSEEN["female"].name}
    assert len(found & known) == 2


@pytest.mark.parametrize("gender", ["female", "male"])
def test_subjects_differ_from_lean_to_heavy(gender):
    data = load_body_model(f"embedded:{gender}")
    litres = []
    for subject in SUBJECTS[gender]:
        corners = shaped_vertices(data, subject.betas[None])[0][data.faces]
        volume = np.linalg.det(corners).sum() / 6
        litres.append(volume * 1000)
    assert max(litres) > 1.35 * min(litres)
    assert np.diff(np.sort(litres)).min() > 1.0


@pytest.mark.parametrize(
    ("subjects", "motions", "complaint"),
    [
        (5, ("waltz",), "motions waltz"),
        (6, ("hips",), "6 sub"),
        (5, (), "no motions"),
        (2, ("hips", "knees", "hips"), "motions hips more than once"),
    ],
)
def test_what_there_is_not_is_refused(subjects, motions, complaint):
    with pytest.raises(DsnetError, match=complaint):
        dyna_takes("female", subjects, motions, 100, 0)


def test_repeated_mosh_motions_are_refused():
    with pytest.raises(DsnetError, match="motions kicking more than once"):
        mosh_takes("female", 5, ("kicking", "kicking"), 2.0)
