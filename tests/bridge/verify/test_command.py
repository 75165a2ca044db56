"""The real thing: every engine in its process, and not one row that fails."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from bridge.runs import read_artifact
from bridge.verify.checks import random_checks
from bridge.verify.engine import REFERENCE


@pytest.fixture(scope="module")
def verified(tmp_path_factory: pytest.TempPathFactory):
    """The command on random weights of small networks: its process, and the rows it wrote."""
    runs = tmp_path_factory.mktemp("runs")
    code = "from bridge.cli import main; main()"
    arguments = ["verify", "--run", "r", "--no-trained", "--profile", "smoke"]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "DSNET_RUNS": str(runs)},
        capture_output=True,
        text=True,
        check=False,
    )
    parity = read_artifact(runs / "r" / "verify").file("parity.json")
    return done, json.loads(parity.read_text())


def test_all_engines_agree_with_the_reference(verified):
    done, parity = verified
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert parity["passed"]


def test_every_case_has_its_row(verified):
    rows = {(row["check"], row["engine"], row["dtype"]) for row in verified[1]["rows"]}
    checks = random_checks(0, "embedded:female")
    engines = {engine for check in checks for engine in check.engines}
    asked = {
        (check.name, engine, dtype)
        for engine in engines - {REFERENCE}
        for check in checks
        for dtype in check.precisions(engine)
    }
    assert rows == asked


def test_differences_are_real_numbers_and_float32_differs(verified):
    """Engines that gave the reference back, or one another's precision, would differ by nothing."""
    layers = [row for row in verified[1]["rows"] if row["part"] == "layers"]
    single = [row["max_rel"] for row in layers if row["dtype"] == "float32"]
    double = [row["max_rel"] for row in layers if row["dtype"] == "float64"]
    assert min(single) > 1e-9 > max(double)
