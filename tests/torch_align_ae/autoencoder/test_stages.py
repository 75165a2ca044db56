"""train-ae, encode and decode on a small aligned corpus of full-sized meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from bridge import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.dsnet import LATENTS_OF, LITERAL_CODES
from bridge.motion import MotionSequence, sequences_of, to_manifest
from bridge.motion.splits import split_frames
from bridge.runs import ArtifactWriter, Run
from bridge.runs.artifact import DataOrigin
from tests.forged.dmpl import forged_directions, save_dmpl
from torch_align_ae.autoencoder import stage_decode, stage_encode, stage_train_ae
from torch_align_ae.autoencoder.codes import Codec, load_codec, load_codecs
from torch_align_ae.autoencoder.stage_encode import EncodeConfig
from torch_align_ae.autoencoder.stage_train_ae import TrainAutoencoderConfig

NAMES = [("s1", "hop"), ("s1", "run"), ("s1", "jump"), ("s2", "hop"), ("s2", "run")]
SPLITS = ["train", "train", "validation", "train", "train"]
LENGTH = 8
CONFIG = TrainAutoencoderConfig(run="r", steps=2, batch_size=16, patience=0, literal_steps=0)
AS_RUN = replace(CONFIG, literal_steps=1)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(tmp_path_factory.mktemp("runs")))
        leave_align(Run("r"))
        stage_train_ae.main(AS_RUN)
        stage_encode.main(EncodeConfig(run="r"))
        _write_prediction(Run("r"))
        stage_decode.main(stage_decode.DecodeConfig(run="r"))
        yield Run("r")


def _index() -> list[MotionSequence]:
    return [
        MotionSequence(f"{subject}_{motion}", subject, motion, k * LENGTH, LENGTH, 60.0, split)  # type: ignore[arg-type]
        for k, ((subject, motion), split) in enumerate(zip(NAMES, SPLITS, strict=True))
    ]


def leave_align(run: Run, garbled: int | None = None, data: DataOrigin = "synthetic") -> None:
    frames = len(NAMES) * LENGTH
    rng = np.random.default_rng(0)
    waves = rng.standard_normal((frames, 4)) @ rng.standard_normal((4, 6890 * 3)) * 1e-3
    if garbled is not None:
        rows = slice(garbled * LENGTH, (garbled + 1) * LENGTH)
        waves[rows] = 0.05 * rng.standard_normal(waves[rows].shape)
    writer = ArtifactWriter(run.path / "align", "align", data=data)
    writer.put("offsets", waves.reshape(frames, 6890, 3).astype(np.float32), "m")
    writer.put("theta", rng.standard_normal((frames, 69)).astype(np.float32), "rad, then m")
    writer.put("betas", rng.standard_normal((2, 10)).astype(np.float32), "1")
    writer.record(sequences=to_manifest(_index()))
    writer.finish()


def _write_prediction(run: Run) -> None:
    latents = np.asarray(run.artifact("encode").array("latents"))
    unseen = MotionSequence("s9_kick", "s9", "kick", len(latents), LENGTH, 60.0, "test")
    writer = ArtifactWriter(run.path / "infer", "infer", data="synthetic")
    both = np.concatenate([latents, latents[:LENGTH]])
    writer.put("latents_one", both + 0.1, "1")
    writer.put("latents_other", both * 0.5, "1")
    writer.record(
        sequences=to_manifest([*_index(), unseen]),
        predictors={"one": "One", "other": "Other"},
        default="one",
    )
    writer.finish()


def test_training_records_what_it_did(run):
    manifest = run.artifact("train-ae").manifest
    summary = manifest["autoencoder"]
    assert (summary["train_frames"], summary["validation_frames"]) == (22, 10)
    assert summary["normalisation"] == "standard"
    assert summary["departures"]
    assert manifest["parameters"]["mesh_autoencoder"] == 33_626_606
    trained = run.artifact("train-ae")
    assert trained.array("loss").shape == (1,)
    assert np.isfinite(trained.array("validation_loss")).all()
    np.testing.assert_array_equal(trained.array("validation_steps"), [0, 2])
    assert not summary["include_held_out"]


@pytest.mark.slow
def test_the_processor_decides_the_precision_unless_told(run, monkeypatch):
    found = {}
    for asked, fast in (("auto", True), ("auto", False), ("float32", True)):
        monkeypatch.setattr(stage_train_ae, "multiplies_bfloat16", lambda fast=fast: fast)
        config = replace(CONFIG, run=f"{asked}_{fast}", precision=asked)
        leave_align(Run(config.run))
        stage_train_ae.main(config)
        trained = Run(config.run).artifact("train-ae")
        summary = trained.manifest["autoencoder"]
        found[asked, fast] = summary["precision"], float(trained.array("loss")[0])
    rounded, *exact = found.values()
    assert exact[0] == exact[1]
    assert (rounded[0], exact[0][0]) == ("bfloat16", "float32")
    assert rounded[1] != exact[0][1]
    assert rounded[1] == pytest.approx(exact[0][1], abs=1e-3)  # of offsets of unit variance


@pytest.mark.parametrize("code", LITERAL_CODES)
def test_beside_it_stands_the_same_network_by_the_papers_words_alone(run, code):
    trained, encode = run.artifact("train-ae"), run.artifact("encode")
    summary = trained.manifest[code]
    assert summary["departures"] == []
    assert (summary["precision"], summary["learning_rate"]) == ("float32", 1e-4)
    assert (summary["train_frames"], summary["validation_frames"]) == (28, 12)  # of all 40 meshes
    assert trained.array(f"validation_loss_{code}").shape == (2,)
    codec = load_codecs(trained)[code]
    assert isinstance(codec, Codec)
    frames = split_frames(np.arange(40), 0).train
    offsets_m = np.asarray(run.artifact("align").array("offsets")[frames])
    values = codec.normaliser.normalise(torch.from_numpy(offsets_m)).numpy()
    assert np.abs(values).max() == pytest.approx(1, abs=1e-6)
    if code == "literal_per_coordinate":
        np.testing.assert_allclose(values.min(axis=0), -1, atol=1e-5)
        np.testing.assert_allclose(values.max(axis=0), 1, atol=1e-5)
    latents = encode.array(LATENTS_OF[code])
    np.testing.assert_allclose(latents[frames], codec.encode(offsets_m), atol=1e-5)


@pytest.mark.slow
def test_a_run_of_a_literal_preset_has_that_code_alone(run):
    del run  # its folder of runs
    config = replace(CONFIG, run="alone", preset="literal", steps=1, literal_steps=1)
    leave_align(Run(config.run))
    stage_train_ae.main(config)
    trained = Run(config.run).artifact("train-ae")
    assert list(load_codecs(trained)) == ["autoencoder", "pca"]
    summary = trained.manifest["autoencoder"]
    assert (summary["departures"], summary["include_held_out"]) == ([], True)


@pytest.fixture(scope="module")
def other(run, tmp_path_factory):
    """As if licensed, with DMPL beside it, and another clip held out."""
    dmpl = save_dmpl(tmp_path_factory.mktemp("dmpls") / "female" / "model.npz")
    leave_align(Run("other"), garbled=SPLITS.index("validation"), data="licensed")
    stage_train_ae.main(replace(CONFIG, run="other", dmpl=dmpl))
    return Run("other")


def test_the_held_out_clip_changes_nothing_that_is_trained(run, other):
    """Its frames reach neither normaliser nor initialisation, gradients or choice of weights."""
    file = "autoencoder.safetensors"
    weights = [load_weights(r.artifact("train-ae").file(file)) for r in (run, other)]
    for name, array in weights[0].items():
        np.testing.assert_array_equal(weights[1][name], array, err_msg=name)
    pca = [r.artifact("train-ae").manifest["pca"] for r in (run, other)]
    assert pca[0]["r2_validation"] == pca[1]["r2_validation"]
    assert pca[0]["r2_held_out"] != pca[1]["r2_held_out"]


def test_dmpl_is_a_third_code_beside_licensed_meshes(other):
    stage_encode.main(EncodeConfig(run="other"))
    trained, encode, align = (other.artifact(s) for s in ("train-ae", "encode", "align"))
    assert encode.array("latents_dmpl").shape == (len(NAMES) * LENGTH, 8)
    assert encode.manifest["arrays"]["latents_dmpl"]["unit"] == "m"
    kept = load_codecs(trained)["dmpl"].decode(encode.array("latents_dmpl"))
    offsets_m = align.array("offsets").astype(np.float64)
    columns = forged_directions().reshape(-1, 8)
    flat = offsets_m.reshape(len(offsets_m), -1).T
    nearest = columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]
    np.testing.assert_allclose(kept, nearest.T.reshape(kept.shape), atol=1e-6)
    assert 0 < trained.manifest["dmpl"]["r2_validation"] < trained.manifest["pca"]["r2_validation"]


def test_dmpl_is_refused_beside_synthetic_meshes(run, tmp_path):
    dmpl = save_dmpl(tmp_path / "model.npz")
    with pytest.raises(DsnetError, match="beside synthetic meshes"):
        stage_train_ae.main(replace(CONFIG, dmpl=dmpl))


def test_latents_are_the_codecs(run):
    encode, align = run.artifact("encode"), run.artifact("align")
    latents = encode.array("latents")
    codec = load_codec(run.artifact("train-ae"))
    np.testing.assert_allclose(latents, codec.encode(align.array("offsets")), atol=1e-5)
    np.testing.assert_array_equal(encode.array("theta"), align.array("theta"))
    assert sequences_of(encode) == sequences_of(align)


def test_decoded_sequences_lie_where_the_index_says(run):
    decode, predict = run.artifact("decode"), run.artifact("infer")
    index = sequences_of(decode)
    assert [s.name for s in index] == ["s1_hop", "s1_jump", "s2_hop", "s9_kick"]
    assert [s.start for s in index] == [0, 8, 16, 24]
    codec = load_codec(run.artifact("train-ae"))
    jump = index[1]
    for name in ("one", "other"):
        expected = codec.decode(predict.array(f"latents_{name}")[16:24])
        found = decode.array(f"offsets_{name}")[jump.frames]
        np.testing.assert_allclose(found, expected, atol=1e-7)
    assert decode.manifest["predictors"] == {"one": "One", "other": "Other"}
    assert decode.manifest["default"] == "one"
    kept = codec.decode(run.artifact("encode").array("latents")[16:24])
    np.testing.assert_allclose(decode.array("offsets_autoencoder")[jump.frames], kept, atol=1e-7)


def test_unaligned_sequences_have_zero_rows(run):
    rows = run.artifact("decode").array("offsets_autoencoder")
    assert not rows[24:].any()
    assert rows[:24].any(axis=(1, 2)).all()
