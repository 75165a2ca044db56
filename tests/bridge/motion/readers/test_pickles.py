"""Pickles, torch files and places of joints: whose poses are taken, and what is refused."""

from __future__ import annotations

import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import load_motion
from bridge.motion.readers import find_motion_files, pickles, read_motion_file
from tests.forged.amass import save, smplh
from tests.forged.foreign_pickles import by_joblib, by_torch
from tests.forged.motion_kinds import KINDS
from tests.forged.walks import FRAMES, joints_m, person, walk, y_up

FPS = 60.0


def refused(path: Path, fps: float | None = FPS) -> str:
    with pytest.raises(DsnetError) as caught:
        load_motion(path, fps)
    assert "\n" not in str(caught.value)
    return str(caught.value)


class Evil:
    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return os.system, ("touch /nowhere",)


@pytest.mark.parametrize("write", [pickle.dumps, by_joblib, by_torch])
def test_the_worlds_poses_of_whom_is_seen_longest_are_taken(
    tmp_path: Path, write: Callable[[Any], bytes]
) -> None:
    path = tmp_path / "people.pkl"
    short = person(pose=y_up()[:9], trans=walk()[1][:9], betas=np.zeros((9, 10)))
    whole = person(pose=0 * y_up(), pose_world=y_up(), trans_world=walk()[1])
    path.write_bytes(write({3: short, 7: whole}))
    motion = load_motion(path, FPS)
    np.testing.assert_allclose(motion.trans_m, walk()[1], atol=1e-9)
    np.testing.assert_allclose(motion.pose[0], walk()[0][0], atol=1e-6)
    assert "2 people" in motion.notes[0]


def test_what_is_no_motion_says_why(tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"pose": Evil()}))
    assert "asks to run" in refused(path)
    path.write_bytes(pickle.dumps({0: person()}))
    assert "does not say its rate" in refused(path, None)
    path.write_bytes(pickle.dumps({"v_template": np.zeros((6890, 3))}))
    assert "without poses of SMPL" in refused(path)
    upside_down = y_up()
    upside_down[:, :3] = [np.pi, 0, 0]
    path.write_bytes(pickle.dumps({0: person(pose=upside_down)}))
    assert "space of a camera" in refused(path)
    path.write_bytes(pickle.dumps({"smpl_poses": y_up(), "smpl_trans": walk()[1],
                                   "smpl_scaling": np.array([0.0])}))  # fmt: skip
    assert "smpl_scaling" in refused(path)
    assert "does not exist" in refused(tmp_path / "none.pkl")


@pytest.mark.parametrize("what", ["short", "missing", "deflated"])
def test_a_torch_file_whose_numbers_are_not_there_is_refused(tmp_path: Path, what: str) -> None:
    path = tmp_path / "a.pt"
    path.write_bytes(by_torch({"pose": y_up(), "trans": walk()[1]}))
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            is_first = name.endswith("data/0")
            if not (is_first and what == "missing"):
                archive.writestr(
                    name,
                    data[:800] if is_first and what == "short" else data,
                    zipfile.ZIP_DEFLATED if what == "deflated" else zipfile.ZIP_STORED,
                )
    assert "does not load" in refused(path)


@pytest.mark.parametrize("write", [pickle.dumps, by_torch])
def test_what_stands_beside_poses_is_not_read(tmp_path: Path, write) -> None:
    beside = {"source": PurePosixPath("/videos/a.mp4"), "visible": np.ones(len(y_up()), bool)}
    (tmp_path / "a.pt").write_bytes(write({"pose": y_up(), "trans": walk()[1], **beside}))
    assert len(read_motion_file(tmp_path / "a.pt").theta) == len(y_up())


@pytest.mark.parametrize("module", [b"pathlib", b"pathlib._local"])
def test_a_path_that_any_python_wrote_is_not_read(tmp_path: Path, module: bytes) -> None:
    person = {"pose": y_up(), "trans": walk()[1], "source": PurePosixPath("/videos/a.mp4")}
    # Protocol 2 writes names of modules as lines.
    before, _, after = pickle.dumps(person, protocol=2).partition(b"cpathlib")
    (tmp_path / "a.pkl").write_bytes(before + b"c" + module + after[after.index(b"\n") :])
    assert len(read_motion_file(tmp_path / "a.pkl").theta) == len(y_up())


def test_joints_of_mdm_are_its_first_sample(tmp_path: Path) -> None:
    motions = np.stack([joints_m(), 0 * joints_m()]).transpose(0, 2, 3, 1)
    path = tmp_path / "results.npy"
    np.save(path, np.array({"motion": motions, "text": ["walks", "rests"]}, dtype=object))
    motion = load_motion(path)
    np.testing.assert_allclose(motion.trans_m[0], walk()[1][0], atol=1e-6)
    assert motion.source_fps == 20.0


@pytest.mark.parametrize(
    ("file", "gender", "fps"),
    [("3dpw.pkl", "female", 30.0), ("emdb.pkl", "female", np.nan), ("motion_x.npy", "unknown", 30)],
)
def test_what_a_dataset_says_of_all_is_everybodys(
    tmp_path: Path, file: str, gender: str, fps: float
) -> None:
    (kind,) = (kind for kind in KINDS if kind.file == file)
    motion = read_motion_file(kind.write(tmp_path))
    assert motion.gender == gender
    np.testing.assert_equal(motion.fps, fps)
    np.testing.assert_array_equal(motion.betas, np.zeros(10))


@pytest.mark.parametrize(
    ("array", "complaint"),
    [
        (np.zeros((FRAMES, 263)), "features"),
        (np.zeros((FRAMES, 21, 3)), "shape"),
        (np.zeros((FRAMES, 22, 3)), "no length"),
        (np.zeros((0, 22, 3)), "0 frames"),
        (np.full((3, 22, 3), np.nan), "not all finite"),
        (np.array({"motion": 1}, dtype=object), "does not load"),
    ],
)
def test_other_arrays_are_refused(tmp_path: Path, array: np.ndarray, complaint: str) -> None:
    np.save(tmp_path / "a.npy", array)
    assert complaint in refused(tmp_path / "a.npy", None)


def test_a_folder_of_any_kind_is_searched(tmp_path: Path) -> None:
    save(tmp_path / "anna" / "walk_poses.npz", smplh())
    (tmp_path / "anna" / "run.pkl").write_bytes(pickle.dumps({0: person()}))
    (tmp_path / "anna" / "his.pkl").write_bytes(pickle.dumps(person() | {"gender": "male"}))
    (tmp_path / "anna" / "model.pkl").write_bytes(pickle.dumps({"v_template": np.zeros(3)}))
    (tmp_path / "anna" / "odd.pt").write_bytes(b"PK")
    np.save(tmp_path / "anna" / "hop.npy", joints_m())
    np.save(tmp_path / "anna" / "kick.npy", np.zeros((9, 322)))
    np.save(tmp_path / "anna" / "mean.npy", np.zeros(263))
    found = {path.name for path in find_motion_files(tmp_path, "female")}
    assert found == {"walk_poses.npz", "run.pkl", "hop.npy", "kick.npy"}
    (tmp_path / "anna" / "half_stageii.pkl").write_bytes(b"PK")
    with pytest.raises(DsnetError, match=r"half_stageii\.pkl, which does not load"):
        find_motion_files(tmp_path, "female")
    assert pickles.gender_of(tmp_path / "none.pkl") is None


def test_tensors_that_pickle_alone_wrote_are_named(tmp_path: Path) -> None:
    """`torch.storage._load_from_bytes` reads with PyTorch's own unpickler, which runs things."""
    (tmp_path / "a.pkl").write_bytes(b"\x80\x02ctorch.storage\n_load_from_bytes\n.")
    assert "tensors of PyTorch, pickled without torch.save" in refused(tmp_path / "a.pkl")
