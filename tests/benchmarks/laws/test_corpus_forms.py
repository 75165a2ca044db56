"""The stage's choices: which law, which form, and what each writes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.laws.captured import CapturedForm
from bridge.body import load_body_model
from bridge.meshes.dyna_files import dyna_sequences
from bridge.motion import sequences_of, subject_rows
from bridge.runs import read_artifact
from dsnet.synthetic import stage_corpus as stage
from dsnet.synthetic.simulation import posed_meshes
from tests.dsnet.synthetic.test_stage_corpus import TINY

SECOND = replace(TINY, tissue="second", form="captured", gravity=False, seed=5)


@pytest.fixture(scope="module")
def config():
    return SECOND


def test_manifests_record_law_form_and_gravity(truth, corpus):
    for artifact in (truth, corpus):
        config = artifact.manifest["config"]
        chosen = [config[name] for name in ("tissue", "form", "gravity")]
        assert chosen == ["second", "captured", False]


def test_every_sequence_has_a_truth_of_what_moves_and_of_what_does_not(truth):
    form = CapturedForm(load_body_model("embedded:female"), seed=5)
    tests = 0
    for sequence in sequences_of(truth):
        tests += sequence.split == "test"
        theta = truth.array("theta")[sequence.frames].astype(np.float64)
        expected = form.static(sequence.subject, theta)
        np.testing.assert_array_equal(truth.array("static")[sequence.frames], expected)
        assert np.abs(truth.array("offsets")[sequence.frames]).max() > 5e-3
    assert tests


def test_meshes_are_posed_with_both_then_slid_and_noisy(truth, corpus):
    body = load_body_model("embedded:female")
    form, rows = CapturedForm(body, seed=5), subject_rows(sequences_of(truth))
    (sequence,) = sequences_of(corpus)
    arrays = {name: truth.array(name)[sequence.frames] for name in ("theta", "offsets", "static")}
    betas = truth.array("betas")[rows[sequence.subject]].astype(np.float64)
    both = arrays["offsets"] + arrays["static"]
    meshes = posed_meshes(body, betas, arrays["theta"].astype(np.float64), both)
    meshes_of = {one.name: one for one in dyna_sequences([corpus.file("dyna_female.h5")])}
    found = meshes_of[sequence.name].read()
    np.testing.assert_array_equal(found, form.registered(sequence.name, meshes, 60.0))
    beside = np.linalg.norm(found - meshes, axis=-1)
    assert 0.0007 < np.sqrt((beside**2).mean()) < 0.003


def test_the_clean_form_has_no_static_truth(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    stage.main(TINY)
    assert "static" not in read_artifact(tmp_path / "tiny" / "truth").manifest["arrays"]
