"""A law and a form of somebody's own, by the command line."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.meshes.dyna_files import dyna_sequences
from bridge.motion import sequences_of
from bridge.runs import read_artifact
from dsnet import cli
from tests.forged.plugin import use_plugin

COMMAND = ["corpus", "--profile", "smoke", "--run", "r", "--subjects", "1", "--motions", "hips",
           "--mean-frames", "60", "--mosh-seconds", "1"]  # fmt: skip


@pytest.fixture(autouse=True)
def runs(tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


def test_they_make_a_corpus(tmp_path, monkeypatch, runs):
    use_plugin(tmp_path, monkeypatch)
    cli.main([*COMMAND, "--tissue", "jelly", "--form", "thick"], retakes=0)
    truth, corpus = (read_artifact(runs / "r" / name) for name in ("truth", "corpus"))
    assert (truth.manifest["tissue"], truth.manifest["form"]) == ("jelly", "thick")
    assert not truth.array("static").any()
    for one in sequences_of(truth):
        lag_m = -np.gradient(truth.array("theta")[one.frames, 66:].astype(float), axis=0)
        found = truth.array("offsets")[one.frames]
        np.testing.assert_allclose(found, np.repeat(lag_m[:, None], 6890, 1), atol=1e-6)
    assert len(dyna_sequences([corpus.file("dyna_female.h5")])) == 1
