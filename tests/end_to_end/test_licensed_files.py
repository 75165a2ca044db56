"""Forged licensed files through the command that a licensed user runs."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.meshes.dyna_files import dyna_sequences
from bridge.motion import sequences_of
from bridge.runs import read_artifact
from dsnet.report import stage_report
from dsnet.report.bodies import Scene
from tests.forged.amass import save, shape, smplh, smplx
from tests.forged.dmpl import save_dmpl
from tests.forged.python2_pickle import python2_pickle
from tests.forged.registrations import save_registrations
from tests.forged.smpl import as_chumpy, smpl_fields

RENAMED = {"50004_hips": "50004_running_on_spot_bugfix", "50020_hips": "50020_jumping_jacks"}
AMASS_FILES = {
    "50004_side_to_side_hopping": "MPI_mosh/50004/misc_dancing_hiphop_poses.npz",
    "50020_hips_take2": "MoSh/50020/jumping_jacks_stageii.npz",
    "99001_side_to_side_hopping": "MPI_mosh/00096/simple_crouch2_poses.npz",
    "99003_hips": "MPI_mosh/00031/jumping_jacks 1_poses.npz",
}
"""Where the corpus's motions lie in the download: people and names as public code knows them."""


def forge_meshes(folder: Path, corpus: Path) -> list[Path]:
    """The corpus's meshes as D-FAUST's women, and some of them as a man's."""
    found = dyna_sequences([corpus / "dyna_female.h5"])
    women = {RENAMED.get(one.name, one.name): one.read() for one in found}
    faces = load_body_model("embedded:female").faces
    men = {"50009_hips": women["50004_one_leg_jump"][:3]}
    return [
        save_registrations(folder / "registrations_f.hdf5", women, faces),
        save_registrations(folder / "registrations_m.hdf5", men, faces, "f4", compression="gzip"),
    ]


def forge_amass(folder: Path, corpus: Path) -> Path:
    """The corpus's motions in both releases, beside what else a download holds; and a list of what
    is to be predicted: all but one."""
    for name, file in AMASS_FILES.items():
        with np.load(corpus / "mosh" / f"{name}_poses.npz") as stored:
            common: dict[str, Any] = {key: stored[key] for key in ("poses", "trans", "betas")}
        layout = smplx if file.startswith("MoSh/") else smplh
        if layout is smplx:
            face_and_hands = np.zeros((len(common["poses"]), 99))
            common["poses"] = np.concatenate([common["poses"][:, :66], face_and_hands], axis=1)
        save(folder / file, layout(len(common["poses"]), 100.0), **common)
    save(folder / "MPI_mosh/50004/shape.npz", shape())
    save(folder / "MPI_mosh/50009/misc_poses.npz", smplh(), gender="male")
    save(folder / "DFaust_67/50004/50004_one_leg_jump_poses.npz", smplh())
    wanted = [path.relative_to(folder).as_posix() for path in folder.rglob("*.npz")]
    (folder / "list.txt").write_text("\n".join(["# Mosh", *wanted, "00096_simple_crouch2"]))
    save(folder / "MPI_mosh/50022/misc_1_poses.npz", smplh())
    return folder


def groups_of_figure9(run: Path) -> dict[str, tuple[str | None, ...]]:
    """Who is shown in each row, known and new."""
    stages = ("evaluate", "align", "infer", "decode", "align_robust", "infer_plus")
    scene = Scene(
        {name: read_artifact(run / name) for name in stages}, load_body_model("embedded:female")
    )
    shown = stage_report._subjects_of_figure9(scene)
    return {row: tuple(one and one.name for one in pair) for row, pair in shown.items()}


@pytest.mark.slow
def test_reproduce_does_it_all(smoke_runs, tmp_path, execute):
    corpus = smoke_runs / "smoke" / "corpus"
    body = load_body_model("embedded:female")
    smpl = tmp_path / "basicModel_f_lbs_10_207_0_v1.0.0.pkl"
    smpl.write_bytes(python2_pickle(as_chumpy(smpl_fields(body)), 2))
    meshes = map(str, forge_meshes(tmp_path, corpus))
    amass = forge_amass(tmp_path / "amass", corpus)
    dmpl = save_dmpl(tmp_path / "dmpls" / "female" / "model.npz")
    options = ["--run", "l", "--smpl", str(smpl), "--dyna", *meshes, "--amass", str(amass)]
    options += ["--amass-list", str(amass / "list.txt")]
    options += ["--dmpl", str(dmpl)]
    command = ["./reproduce.sh", "--profile", "smoke", *options]
    done = execute(command, tmp_path / "runs")
    assert done.returncode == 0, done.stderr
    assert "1 of 5 sequences left out: male subjects, female body model" in done.stderr
    counts = "4 motions; left out: 1 of motions already there, 1 without poses, 1 of male bodies"
    assert counts in done.stderr
    run = tmp_path / "runs" / "l"
    assert not (run / "corpus").exists()
    predicted = read_artifact(run / "infer")
    names = {(s.name, s.split) for s in sequences_of(predicted)}
    assert names == {
        ("50004_one_leg_jump", "validation"),
        ("50004_running_on_spot_bugfix", "train"),
        ("50020_one_leg_jump", "train"),
        ("50020_jumping_jacks", "train"),
        ("50004_misc_dancing_hiphop", "test"),
        ("50020_jumping_jacks_take2", "test"),
        ("00096_simple_crouch2", "test"),
        ("00031_jumping_jacks_1", "test"),
    }
    assert groups_of_figure9(run) == {
        "one leg jump": ("50004_one_leg_jump", None),
        "jumping jacks": ("50020_jumping_jacks_take2", "00031_jumping_jacks_1"),
        "misc dancing hiphop": ("50004_misc_dancing_hiphop", None),
        "simple crouch": (None, "00096_simple_crouch2"),
    }
    assert "Figure 9 is without" not in done.stderr
    assert predicted.origin == "licensed"
    assert predicted.array("latents_dyna_like_dmpl").shape[1] == 8
    report = (run / "report" / "report.md").read_text()
    assert "Made from licensed files" in report
    assert "Dyna-like on DMPL's 8 directions" in report
    assert "Synthetic data" not in report


class TouchesAFile:
    """Writes a file when a plain unpickler reads it."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Any, tuple[Path]]:
        return Path.touch, (self.trace,)


@pytest.mark.parametrize(
    ("smpl", "meshes", "words"),
    [
        ("intruder", "good", "cannot be read safely"),
        ("half", "good", "cannot be read safely"),
        ("good", "z up", "is z up, or it lies"),
        ("good", "millimetres", "in millimetres"),
        ("good", "half", "not readable as HDF5"),
        ("good", "men", "who are male, with a female body model"),
    ],
)
def test_bad_files_are_one_line_and_leave_nothing(
    tmp_path, monkeypatch, refusal, smpl, meshes, words
):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    body = load_body_model("embedded:female")
    trace = tmp_path / "trace"
    fields = smpl_fields(dataclasses.replace(body, posedirs=np.zeros_like(body.posedirs)))
    pickled = python2_pickle(fields | ({"J": TouchesAFile(trace)} if smpl == "intruder" else {}))
    model = tmp_path / "basicModel_f_lbs_10_207_0_v1.0.0.pkl"
    model.write_bytes(pickled[: len(pickled) // (2 if smpl == "half" else 1)])
    frames = np.repeat(body.v_template[None], 2, axis=0)
    frames = {"z up": frames[..., [0, 2, 1]], "millimetres": 1000 * frames}.get(meshes, frames)
    subject = "50009" if meshes == "men" else "50004"
    file = save_registrations(tmp_path / "dyna.h5", {f"{subject}_hips": frames})
    if meshes == "half":
        file.write_bytes(file.read_bytes()[:100_000])
    assert words in refusal("align", "--run", "bad", "--smpl", str(model), "--dyna", str(file))
    assert not trace.exists()
    assert not (tmp_path / "runs").exists()
