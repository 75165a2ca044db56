"""Generations of stages do not mix, and no byte changes unseen, on a real run."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from numpy.lib.format import open_memmap

from tests.end_to_end.test_smoke_run import forged_motion

DSNET = ".venv/bin/dsnet"
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def copied_runs(smoke_runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the finished run that tests may spoil, each in turn."""
    runs = tmp_path_factory.mktemp("copied")
    shutil.copytree(smoke_runs / "smoke", runs / "smoke")
    return runs


def test_a_changed_byte_is_named(copied_runs, execute) -> None:
    array = open_memmap(copied_runs / "smoke" / "encode" / "latents.npy", mode="r+")
    before = float(array[3, 5])
    array[3, 5] = before + 1.0
    array.flush()
    done = execute([DSNET, "check", "--run", "smoke"], copied_runs)
    assert done.returncode == 2
    assert "latents.npy" in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    array[3, 5] = before
    array.flush()
    assert execute([DSNET, "check", "--run", "smoke"], copied_runs).returncode == 0


def test_later_stages_refuse_another_autoencoder(copied_runs, execute, tmp_path) -> None:
    again = [DSNET, "train-ae", "--profile", "smoke", "--seed", "1", "--steps", "1"]
    done = execute([*again, "--run", "smoke"], copied_runs)
    assert done.returncode == 0, done.stderr
    motion = str(forged_motion(tmp_path / "motion_poses.npz"))
    predict = ["predict", "--motion", motion, "--out", str(tmp_path / "out")]
    for command in (
        ["decode"],
        ["evaluate"],
        ["report"],
        [*predict, "--predictor", "dsnet_standardised"],
    ):
        done = execute([DSNET, *command, "--run", "smoke"], copied_runs)
        assert done.returncode == 2, command
        assert done.stderr.count("\n") == 1, done.stderr
        assert "dsnet encode" in done.stderr, done.stderr
    assert not (tmp_path / "out").exists()
    assert execute([DSNET, "check", "--run", "smoke"], copied_runs).returncode == 2
