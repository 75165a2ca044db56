"""`./reproduce.sh --profile smoke --seed 0` twice: every array and every weight, bit for bit."""

from __future__ import annotations

import pytest

from bridge.runs import read_artifact
from tests.smoke_run import ARTIFACTS


@pytest.mark.slow
def test_a_second_run_is_the_first_bit_for_bit(smoke_runs, execute, tmp_path):
    done = execute(["./reproduce.sh", "--profile", "smoke", "--seed", "0"], tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    for stage in ARTIFACTS[:-1]:  # the report prints seconds
        first, second = (read_artifact(runs / "smoke" / stage) for runs in (smoke_runs, tmp_path))
        second.verify()
        for kind in ("arrays", "files"):
            assert first.manifest[kind] == second.manifest[kind], stage
        assert first.content_sha256 == second.content_sha256, stage
