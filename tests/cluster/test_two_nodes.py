"""Stages on a real cluster of two nodes give what they give here, also when a node is lost."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.runs.artifact import read_artifact
from tests.cluster.nodes import TwoNodes, ended_well, start_dsnet
from tests.forged.many_motions import forge, tree
from tests.smoke_run import ARTIFACTS

pytestmark = pytest.mark.cluster
pytest.importorskip("ray", reason="Ray is not installed: extra ray")

STAGES = ("corpus", "align", "train-ae", "encode", "train", "infer", "decode")


@pytest.fixture
def nodes() -> Iterator[TwoNodes]:
    # Names of sockets must be short.
    with tempfile.TemporaryDirectory(prefix="ray", dir="/tmp") as folder:
        nodes = TwoNodes(Path(folder))
        yield nodes
        nodes.close()


def test_a_node_killed_while_tissue_is_simulated_changes_no_bit_of_any_stage(
    smoke_runs, nodes, tmp_path
):
    on_nodes = ("--profile", "smoke", "--run", "there", "--engine", "ray")
    on_nodes += ("--address", nodes.address)
    stage, rest = STAGES[0], STAGES[1:]
    process = start_dsnet(tmp_path, stage, *on_nodes)
    _wait_for(tmp_path / "there" / ".truth.partial" / "checkpoints", "*.done", process)
    nodes.kill_one()
    ended_well(process)
    for stage in rest:
        ended_well(start_dsnet(tmp_path, stage, *on_nodes))
    for name in ARTIFACTS[: ARTIFACTS.index("evaluate")]:
        here = read_artifact(smoke_runs / "smoke" / name)
        there = read_artifact(tmp_path / "there" / name)
        assert here.content_sha256 == there.content_sha256, name


def test_a_folder_of_motions_is_the_same_on_nodes_of_which_one_is_killed(nodes, tmp_path):
    given, command = (
        forge(tmp_path / "given", 40, 30),
        ("predict", "--body", "embedded", "--motion"),
    )
    runs = tmp_path / "runs"
    runs.mkdir()
    ended_well(start_dsnet(runs, *command, str(given), "--out", str(tmp_path / "here")))
    there = (*command, str(given), "--out", str(tmp_path / "there"), "--engine", "ray")
    process = start_dsnet(runs, *there, "--address", nodes.address)
    _wait_for(tmp_path, "there/*/*/*/manifest.json", process)
    nodes.kill_one()
    ended_well(process)
    assert tree(tmp_path / "there") == tree(tmp_path / "here")


def _wait_for(folder: Path, pattern: str, process) -> None:
    """Until work has begun to arrive, and is not over."""
    while not any(folder.glob(pattern)):
        assert process.poll() is None, process.communicate()[0]
        time.sleep(0.05)
