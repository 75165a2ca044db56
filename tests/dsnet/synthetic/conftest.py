"""A finished stage `corpus`; a file says which by a fixture `config` of its own."""

from __future__ import annotations

import pytest

from bridge.runs import read_artifact
from dsnet.synthetic import stage_corpus


@pytest.fixture(scope="module")
def finished(config, tmp_path_factory):
    """The run's folder."""
    root = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(root))
        stage_corpus.main(config)
    return root / config.run


@pytest.fixture
def truth(finished):
    return read_artifact(finished / "truth", kind="truth")


@pytest.fixture
def corpus(finished):
    return read_artifact(finished / "corpus", kind="corpus")
