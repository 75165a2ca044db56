"""The whole road at the paper's sizes on a few seconds of synthetic motion."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from bridge import paper
from bridge.runs import read_artifact
from tests.smoke_run import ARTIFACTS

ROOT = Path(__file__).parents[2]
SAMPLE = Path(os.environ.get("DSNET_TEST_DATA", "nowhere")) / "amass" / "dmpl_sample.npz"

pytestmark = pytest.mark.slow


def test_every_stage_left_a_complete_synthetic_artifact(smoke_runs):
    for stage in ARTIFACTS:
        artifact = read_artifact(smoke_runs / "smoke" / stage)
        artifact.verify()
        assert artifact.origin == "synthetic"
    assert not list((smoke_runs / "smoke").glob(".*"))


def test_a_second_run_makes_nothing_again(smoke_runs, execute):
    manifests = [smoke_runs / "smoke" / stage / "manifest.json" for stage in ARTIFACTS]
    before = [path.stat().st_mtime_ns for path in manifests]
    assert execute(["./reproduce.sh", "--profile", "smoke"], smoke_runs).returncode == 0
    assert [path.stat().st_mtime_ns for path in manifests] == before


def forged_motion(path: Path) -> Path:
    """Two seconds of a swinging arm in AMASS's layout: 100 fps, z up."""
    frames = 201
    poses = np.zeros((frames, 156))
    poses[:, 0] = np.pi / 2  # the root turns SMPL's y-up rest pose to z up
    poses[:, 16 * 3 + 2] = -1.0 + 0.3 * np.sin(np.linspace(0, 12, frames))
    trans = np.tile([0.0, 0.0, 0.95], (frames, 1))
    np.savez(
        path, poses=poses, trans=trans, betas=np.zeros(16), gender="female", mocap_framerate=100.0
    )
    return path


@pytest.mark.licensed
@pytest.mark.skipif(not SAMPLE.exists(), reason="no $DSNET_TEST_DATA/amass/dmpl_sample.npz")
@pytest.mark.parametrize("asked", [None, "dsnet_standardised"])
def test_predict_reads_a_real_amass_file(smoke_runs, tmp_path, execute, asked):
    out = tmp_path / "out"
    command = ["predict", "--run", "smoke", "--motion", str(SAMPLE), "--out", str(out)]
    command += ["--predictor", asked] if asked else []
    done = execute([".venv/bin/dsnet", *command], smoke_runs)
    assert done.returncode == 0, done.stderr
    lines = done.stderr.splitlines()
    assert lines[0].startswith(f"dsnet: the betas of {SAMPLE} are another body model's: ")
    assert lines[1].startswith(f"dsnet: {asked or 'dsnet_plus'} (")
    assert_is_a_standing_body(out, frames=(117, 118), floor_m=0.1)


def assert_is_a_standing_body(out: Path, frames: tuple[int, int], floor_m: float) -> None:
    artifact = read_artifact(out, "prediction")
    artifact.verify()
    found = {name: artifact.array(name) for name in artifact.manifest["arrays"]}
    vertices, count = found["vertices"], len(found["vertices"])
    assert count in frames
    shapes = {name: array.shape for name, array in found.items()}
    latents = None if artifact.manifest["predictor"] == "dsnet_plus" else (count, paper.LATENT_SIZE)
    assert shapes.pop("latents", None) == latents
    assert shapes == dict.fromkeys(("offsets", "vertices"), (count, paper.N_VERTICES, 3))
    assert all(np.isfinite(array).all() for array in found.values())
    low, high = vertices.min(axis=1), vertices.max(axis=1)
    assert (high - low)[:, 1].min() > 1.2  # metres; a body lying down would be 0.3
    assert np.abs(low[:, 1]).min() < floor_m
    assert artifact.manifest["fps"] == 60.0
    assert (out / "strip.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["align", "--run", "bad", "--smpl", "{tmp}/none.npz", "--dyna", "{tmp}/none.h5"], "none"),
        (["align", "--run", "bad", "--smpl", "{tmp}", "--dyna", "{tmp}"], "a folder"),
        (["predict", "--run", "smoke", "--motion", "{tmp}", "--out", "{tmp}/o"], "a folder"),
        (
            ["predict", "--run", "nope", "--motion", "{tmp}/x.npz", "--out", "{tmp}/o"],
            "unknown run",
        ),
        (["encode", "--run", "nope"], "unknown run"),
        (["train", "--run", "nope"], "unknown run"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(smoke_runs, tmp_path, execute, options, words):
    arguments = [option.format(tmp=tmp_path) for option in options]
    done = execute([".venv/bin/dsnet", *arguments], smoke_runs)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
    assert [path.name for path in smoke_runs.iterdir() if path.name[0] != "."] == ["smoke"]


def readme_commands() -> list[str]:
    blocks = re.findall(r"```bash\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    lines = [line.partition("  #")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if "dsnet" in line and "dsnet view" not in line]  # which serves


@pytest.mark.parametrize("command", readme_commands())
def test_the_readmes_own_commands_work(smoke_runs, tmp_path, execute, command):
    folder, out = tmp_path / "motions", tmp_path / "new" / "out"
    folder.mkdir()
    motion = forged_motion(folder / "motion_poses.npz")
    line = command.replace("--run demo", "--run smoke --profile smoke")
    line = line.replace("--body models", "--body embedded")
    line = f".venv/bin/{line}" if line.startswith("dsnet ") else line
    for name, place in {"MOTION.npz": motion, "AMASS": folder, "OUT": out, "FLESH": out}.items():
        line = line.replace(name, str(place))
    done = execute(shlex.split(line), smoke_runs)
    assert done.returncode == 0, done.stderr
    if "AMASS" in command:
        assert np.isfinite(read_artifact(out / "motion_poses").array("offsets")).all()
    elif "predict" in command:
        frames = (240, 240) if "sample:" in command else (120, 121)
        assert_is_a_standing_body(out, frames=frames, floor_m=0.3)
