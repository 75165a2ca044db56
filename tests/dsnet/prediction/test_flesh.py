"""Folders of predicted offsets as data: whose body they move, in which order, and from nodes."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.utils.data import DataLoader

import dsnet
from benchmarks.other_bodies import renumbered
from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.vertex_order import vertex_order
from bridge.runs import Run, read_artifact
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.cli import main
from dsnet.prediction import predict_folder as folders
from dsnet.prediction.interpolation import Interpolation, NodeOffsets
from dsnet.prediction.models import PlusModel
from tests.dsnet.conftest import write_aligned
from tests.forged.amass import save, smplh
from tests.forged.plus import soft_flesh, write_plus

HOME = load_body_model("embedded:female")
HALF_ULP, LEAST_HALF = 2.0**-11, 2.0**-25
"""Of float16: relative, and of what is too small for that, metres."""


@pytest.fixture(scope="module", autouse=True)
def one_process() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(folders, "on_any_node", lambda kind: "serial")
        yield


@pytest.fixture(scope="module")
def body_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A body that does not say that it is free, with SMPL's numbers of vertices and faces in an
    order of its own."""
    path = tmp_path_factory.mktemp("bodies") / "SMPL_FEMALE.npz"
    replace(renumbered(HOME)[0], source="licensed").save_smpl_npz(path)
    return path


@pytest.fixture(scope="module")
def ten(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten clips of ten women, of 4 to 13 frames, who nod."""
    folder, rng = tmp_path_factory.mktemp("ten") / "AMASS", np.random.default_rng(3)
    for number in range(10):
        frames = 4 + number
        poses = smplh(frames)["poses"] + np.cumsum(rng.normal(0, 0.02, (frames, 156)), axis=0)
        betas = np.pad(rng.normal(0, 1, 10), (0, 6))
        path = folder / f"S{number % 3}" / f"{number}_poses.npz"
        save(path, smplh(frames, 60.0), poses=poses, betas=betas, gender="female")
    return folder


@pytest.fixture(scope="module")
def made(ten, body_file, tmp_path_factory) -> Callable[[str, str], Path]:
    """The ten on the body `embedded` or `mine`, in a form of offsets: not to be written."""

    @cache
    def make(body: str, form: str) -> Path:
        out = tmp_path_factory.mktemp("made") / "out"
        body = str(body_file) if body == "mine" else body
        predict(ten, out, "--body", body, "--write", form)
        return out

    return make


def predict(motions: Path, out: Path, *options: str) -> None:
    main(["predict", "--motion", str(motions), "--out", str(out), *options])


def file_betas(ten: Path) -> list[np.ndarray]:
    return [np.load(path)["betas"][:10] for path in sorted(ten.rglob("*.npz"))]


def test_without_a_body_nothing_begins(ten, tmp_path, refusal):
    said = refusal("predict", "--motion", str(ten), "--out", str(tmp_path / "out"))
    assert "--body BODY" in said
    assert "--body embedded" in said
    assert [*tmp_path.iterdir()] == []
    with pytest.raises(DsnetError, match="--body embedded"):
        dsnet.predict(ten, tmp_path / "out")


def test_ones_own_body_takes_the_betas(ten, body_file, made, capsys):
    flesh = dsnet.load_flesh(made("mine", "offsets"), body=body_file)
    capsys.readouterr()
    for clip, betas in zip(flesh, file_betas(ten), strict=True):
        np.testing.assert_array_equal(clip.betas, betas)
        assert clip.vertices == vertex_order(load_body_model(body_file))
    predict(ten, made("mine", "offsets"), "--body", str(body_file))  # once more
    said = capsys.readouterr().err
    assert "10 motions are done, 0 of 0 frames to do" in said
    assert "moves SMPL_FEMALE.npz; of 0 of 10 motions the betas" in said


def test_the_embedded_body_is_meant(ten, made, capsys):
    out = made("embedded", "nodes16")
    capsys.readouterr()
    predict(ten, out, "--body", "embedded", "--write", "nodes16")
    said = capsys.readouterr().err
    assert "moves embedded:female (vertices in another order than SMPL's)" in said
    assert "of 10 of 10 motions the betas are not used" in said
    flesh = dsnet.load_flesh(out, "embedded:male")  # women's and men's have one order
    assert not any(clip.betas.any() for clip in flesh)
    assert {clip.vertices for clip in flesh} == {vertex_order(HOME)}


def test_a_loaded_models_body_is_asked_for_or_ones_own(ten, soft, body_file, tmp_path):
    """Who loaded it on a licensed body has said so; else the run's embedded one is meant."""
    with pytest.raises(DsnetError, match="--body embedded"):
        dsnet.predict(ten / "S0", tmp_path / "run", soft)
    dsnet.predict(ten / "S0", tmp_path / "run", soft, body="embedded")
    dsnet.predict(ten / "S0", tmp_path / "mine", dsnet.load_model(body=body_file))
    for name, body in (("run", HOME), ("mine", load_body_model(body_file))):
        assert len(dsnet.load_flesh(tmp_path / name, body)) == 4


def test_motions_without_smpls_vertices_need_no_body(tmp_path, capsys):
    bvh = tmp_path / "in" / "walk.bvh"
    bvh.parent.mkdir()
    main(["export", "--to", "bvh", "--motion", "sample:walk_cycle", "--out", str(bvh)])
    predict(tmp_path / "in", tmp_path / "out")
    assert "of 0 of 1 motions the betas are not used" in capsys.readouterr().err


def test_one_file_moves_as_ever_and_is_told(ten, tmp_path, capsys):
    path = next(ten.rglob("*.npz"))
    for options, told in ((), True), (("--body", "embedded"), False):
        predict(path, tmp_path / "one", "--write", "nodes16", *options)
        assert ("in another order than SMPL's" in capsys.readouterr().err) == told
    (clip,) = dsnet.load_flesh(tmp_path / "one")
    assert clip.offsets_m.shape == (len(clip), 6890, 3)
    predict(path, tmp_path / "one", "--write", "offsets")
    with pytest.raises(DsnetError, match="without the motion"):
        dsnet.load_flesh(tmp_path / "one")[0]


def test_another_order_is_refused(made, body_file):
    """The trap: as many vertices and faces, in another order."""
    out, mine = made("embedded", "nodes16"), load_body_model(body_file)
    assert (mine.v_template.shape, mine.faces.shape) == (HOME.v_template.shape, HOME.faces.shape)
    with pytest.raises(DsnetError, match=r"SMPL_FEMALE\.npz") as refused:
        dsnet.load_flesh(out, body=body_file)
    assert "order" in str(refused.value)
    with pytest.raises(DsnetError, match="order"):
        dsnet.load_flesh(out / "S0", body=mine)


def test_the_order_is_that_of_the_vertices_alone():
    rng = np.random.default_rng(0)
    faces = np.roll(HOME.faces, 1, axis=1)[rng.permutation(len(HOME.faces))]
    taller = HOME.v_template.astype(np.float32) * 1.1
    same = replace(HOME, faces=faces, v_template=taller, name="other")
    assert vertex_order(same) == vertex_order(HOME)
    assert vertex_order(replace(HOME, faces=HOME.faces[:, ::-1])) != vertex_order(HOME)
    swapped = np.arange(HOME.vertex_count)
    swapped[[10, 4000]] = 4000, 10
    assert vertex_order(replace(HOME, faces=swapped[HOME.faces])) != vertex_order(HOME)


def test_a_data_loader_takes_it(made):
    flesh = pickle.loads(pickle.dumps(dsnet.load_flesh(made("embedded", "nodes16"))))
    batches = [*DataLoader(flesh, batch_size=4, shuffle=True, collate_fn=list)]
    assert [len(batch) for batch in batches] == [4, 4, 2]
    clips = {clip.name: clip for batch in batches for clip in batch}
    assert sorted(clips) == flesh.names
    for clip in clips.values():
        assert clip.offsets_m.shape == (len(clip), 6890, 3)
        assert (clip.pose.shape, clip.trans_m.shape) == ((len(clip), 22, 3), (len(clip), 3))
    assert flesh[-1].name == flesh.names[-1]
    with pytest.raises(IndexError):
        flesh[10]


def test_theta_is_the_motion_that_moves(ten, tmp_path):
    path = min(ten.rglob("*.npz"))
    predict(path.parent, tmp_path / "out", "--body", "embedded", "--gain", "2")
    clip = dsnet.load_flesh(tmp_path / "out")[0]
    moving = dsnet.animate(path, body="embedded", gain=2.0)
    np.testing.assert_allclose(clip.theta, moving.motion.theta, atol=1e-6)
    np.testing.assert_array_equal(clip.offsets_m, moving.arrays()[1])
    assert (clip.fps, clip.gender) == (60.0, "female")


def test_nodes_are_small_and_give_the_same_offsets(made):
    """On a body that flesh was carried over to; read in pieces as whole."""
    folders = [made("mine", form) for form in ("offsets", "offsets16", "nodes16")]
    (interpolation,) = folders[-1].glob("interpolation-*.safetensors")
    assert interpolation.stat().st_size < 500_000
    for whole, half, nodes in zip(*map(dsnet.load_flesh, folders), strict=True):
        assert (whole.offsets_m.dtype, half.offsets_m.dtype) == (np.float32, np.float16)
        assert isinstance(nodes.offsets_m, NodeOffsets)
        assert nodes.offsets_m.nodes_m.nbytes * 13 < half.offsets_m.nbytes
        found_m = np.asarray(nodes.offsets_m)
        size_m = np.abs(whole.offsets_m).max()
        np.testing.assert_allclose(found_m, whole.offsets_m, atol=HALF_ULP * size_m)
        np.testing.assert_array_equal(nodes.offsets_m[1:3], found_m[1:3])
        np.testing.assert_array_equal(nodes.offsets_m[-1], found_m[-1])
        np.testing.assert_array_equal(nodes.offsets_m[np.array([2, 0])], found_m[[2, 0]])


def with_static(model: TrainedPlus) -> TrainedPlus:
    """A known person with a constant at every vertex, and deformation by the pose."""
    rng, static = np.random.default_rng(4), model.static
    constant = rng.normal(0, 2e-3, static.constant_m.shape).astype(np.float32)
    by_pose = rng.normal(0, 1e-3, static.by_pose_m.shape).astype(np.float32)
    return replace(model, static=replace(static, constant_m=constant, by_pose_m=by_pose))


@pytest.mark.parametrize("betas", ["0" + ",0" * 9, "1" + ",0" * 9])
def test_gains_of_parts_and_a_persons_constant_stay(betas, tmp_path, monkeypatch):
    """What is not of the nodes, or would be lost where a part's gain is zero."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    run = write_aligned(Run("r"))
    write_plus(run, with_static(soft_flesh(HOME)))
    poses = smplh(20)["poses"]
    poses[10:] += np.random.default_rng(1).normal(0, 0.1, 156)
    woman = smplh(20, 60.0) | {"source": "synthetic", "gender": "female", "poses": poses}
    path = save(tmp_path / "in" / "a.npz", woman)
    options = "--run", "r", "--betas", betas, "--gain", "2", "--part-gain", "belly=0", "chest=3"
    for form in ("offsets", "nodes16"):
        predict(path.parent, tmp_path / form, *options, "--write", form)
    (whole,), (nodes,) = (dsnet.load_flesh(tmp_path / form) for form in ("offsets", "nodes16"))
    held = read_artifact(tmp_path / "nodes16" / "a").manifest["arrays"]
    assert ("constant" in held) == (betas[0] == "0")
    size_m = np.abs(whole.offsets_m).max()
    assert size_m > 1e-3
    np.testing.assert_allclose(np.asarray(nodes.offsets_m), whole.offsets_m, atol=1e-3 * size_m)


@pytest.fixture(scope="module")
def carried() -> PlusModel:
    return PlusModel(soft_flesh(HOME), HOME)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**16), exponent=st.floats(-5, -1), gain=st.floats(0, 20))
def test_every_offset_is_linear_in_the_nodes(carried, seed, exponent, gain):
    """Read at the nodes' vertices and spread again they are the same to 1e-4 of their size; as
    float16 a node is off by half a unit in the last place, and no vertex by more than its share."""
    rng, nodes = np.random.default_rng(seed), carried.trained.nodes
    codes = rng.normal(0, 10**exponent, (2, 3, len(nodes))).astype(np.float32)
    offsets_m = carried.offsets_m(np.zeros(10), codes, np.zeros((2, 69)))
    shares = (nodes.shares * np.float32(gain)).astype(np.float32)
    interpolation = Interpolation(nodes.owners, shares, len(nodes))
    at_nodes = offsets_m[:, nodes.vertices]
    expected_m, size_m = offsets_m * np.float32(gain), gain * np.abs(offsets_m).max()
    found_m = np.asarray(NodeOffsets(at_nodes, interpolation))
    np.testing.assert_allclose(found_m, expected_m, atol=1e-4 * size_m + 1e-12)
    half_m = np.asarray(NodeOffsets(at_nodes.astype(np.float16), interpolation))
    rounded_m = np.abs(at_nodes) * HALF_ULP + LEAST_HALF
    most_m = np.stack([abs(interpolation.matrix) @ frame for frame in rounded_m])
    assert (np.abs(half_m - expected_m) <= most_m * 1.01 + 1e-6 * size_m).all()


def test_a_killed_run_of_nodes_goes_on(ten, tmp_path, capsys):
    """What lost its interpolation is made again: nothing else says what its nodes mean."""
    ten, out = shutil.copytree(ten / "S0", tmp_path / "S0"), tmp_path / "out"
    options = "--body", "embedded", "--write", "nodes16"
    predict(ten, out, *options)
    before = {path: path.read_bytes() for path in out.rglob("*.npy")}
    shutil.rmtree(out / "0_poses")
    capsys.readouterr()
    predict(ten, out, *options)
    assert "3 motions are done, 1 of 4 frames to do" in capsys.readouterr().err
    (interpolation,) = out.glob("interpolation-*")
    whole = interpolation.read_bytes()
    interpolation.unlink()
    with pytest.raises(DsnetError, match="which says how they move vertices"):
        dsnet.load_flesh(out)[0]
    predict(ten, out, *options)
    assert interpolation.read_bytes() == whole
    assert {path: path.read_bytes() for path in out.rglob("*.npy")} == before


def test_networks_without_nodes_are_refused(trained_run, motion, tmp_path):
    with pytest.raises(DsnetError, match="nodes16 of dsnet_standardised, which has no nodes"):
        dsnet.predict(motion, tmp_path / "out", trained_run, write=["nodes16"])


@pytest.mark.parametrize("empty", [True, False])
def test_folders_without_offsets_are_refused(empty, motion, tmp_path):
    (tmp_path / "out").mkdir()
    if not empty:
        dsnet.predict(motion, tmp_path / "out", write=["vertices"])
    with pytest.raises(DsnetError, match="holds no predicted offsets"):
        dsnet.load_flesh(tmp_path / "out")
