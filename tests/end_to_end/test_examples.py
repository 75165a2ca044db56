"""Every example runs as it stands, and is short enough to be read."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.runs import read_artifact
from tests.sources import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
LONGEST = 40
SAYS = {
    "01_load_a_body.py": "6890 vertices",
    "02_read_a_motion.py": "240 frames",
    "03_predict.py": "3.20 to  4.00 s",
    "04_stream.py": "remaining characters: (1,)",
    "05_gain.py": "gain=0.5: offsets of up to",
    "06_export.py": "body.onnx: 25.1 MB",
    "07_train_on_your_own_meshes.py": "",
    "08_verify.py": "65,140 parameters",
    "09_onnx_runtime_only.py": "",
    "10_write_a_dataset.py": "walk_cycle/walk_cycle_poses: (",
    "11_your_own_body.py": "smpl of 6890 vertices, male",
    "13_pytorch_layer.py": "(2, 90, 6890, 3)",
}
APART = ("05", "07", "08", "09")
"""Which take longer, or need what another test makes."""


def run_example(path: Path, folder: Path, *arguments: object, **environment: str) -> str:
    """What an example prints; warnings are errors."""
    command = [sys.executable, "-W", "error", str(path), *map(str, arguments)]
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_known_here_and_short() -> None:
    assert [path.name for path in EXAMPLES] == list(SAYS)
    assert all(len(path.read_text().splitlines()) <= LONGEST for path in EXAMPLES)


@pytest.mark.parametrize(
    "path",
    [path for path in EXAMPLES if not path.name.startswith(APART)],
    ids=lambda path: path.stem,
)
def test_it_runs(path: Path, tmp_path: Path) -> None:
    assert SAYS[path.name] in run_example(path, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["05_gain.py", "08_verify.py"])
def test_it_runs_too(name: str, tmp_path: Path) -> None:
    assert SAYS[name] in run_example(ROOT / "examples" / name, tmp_path)


@pytest.mark.slow
def test_the_notebook_runs(smoke_runs: Path, tmp_path: Path) -> None:
    cells = json.loads((ROOT / "examples" / "12_keras.ipynb").read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert not any(cell.get("outputs") for cell in cells)
    script = tmp_path / "cells.py"
    script.write_text("\n\n".join(code), encoding="utf-8")
    environment = {"RUN": "smoke", "DSNET_RUNS": str(smoke_runs), "MPLBACKEND": "agg"}
    assert "65,140" in run_example(script, tmp_path, **environment)


@pytest.mark.slow
def test_training_on_meshes_of_ones_own_runs(smoke_runs: Path, tmp_path: Path) -> None:
    corpus = smoke_runs / "smoke" / "corpus"
    files = corpus / "SMPL_FEMALE.npz", corpus / "dyna_female.h5"
    run_example(ROOT / "examples" / "07_train_on_your_own_meshes.py", tmp_path, *files)
    made = read_artifact(tmp_path / "runs" / "mine_walking", "prediction")
    assert made.array("vertices").shape == (240, 6890, 3)
    assert made.manifest["predictor"] == "dsnet_plus"
