"""The robust aligner as a stage."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import torch

from bridge.errors import DsnetError
from bridge.motion import sequences_of, unpack_theta
from bridge.runs import Run
from torch_align_ae.alignment.robust import RobustSettings, corpus_fit
from torch_align_ae.alignment.stage_align import AlignConfig, main
from torch_align_ae.corpus.dyna_files import write_dyna

SETTINGS = RobustSettings(vertices=300, steps=3, calibration_frames=16, calibration_rounds=3)


@pytest.fixture
def config(corpus, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    folder = corpus[0]
    return AlignConfig(
        run="t",
        smpl=folder / "SMPL_FEMALE.npz",
        dyna=(folder / "dyna.h5",),
        aligner="robust",
        robust=SETTINGS,
    )


def arrays_of(config):
    main(config)
    artifact = Run(config.run).artifact("align")
    return artifact, {name: np.array(artifact.array(name)) for name in artifact.manifest["arrays"]}


def test_artifact_has_the_contracts_arrays_and_what_was_learned(config):
    _, arrays = arrays_of(config)
    shapes = {name: array.shape for name, array in arrays.items()}
    size = len(arrays["sample_vertices"])
    assert shapes == {
        "betas": (2, 10),
        "theta": (58, 69),
        "offsets": (58, 6890, 3),
        "frame_error": (58,),
        "compliance": (2, 4, size),
        "deviation": (2, size),
        "noise": (2,),
        "sample_vertices": (size,),
    }


def test_rows_describe_their_frames(config, smpl):
    artifact, arrays = arrays_of(config)
    with h5py.File(config.dyna[0]) as file:
        for sequence in sequences_of(artifact):
            rows = sequence.frames
            pose, trans = (torch.tensor(part) for part in unpack_theta(arrays["theta"][rows]))
            row = {"50004": 0, "50020": 1}[sequence.subject]
            betas = torch.tensor(arrays["betas"][row]).expand(sequence.length, -1)
            mesh = np.moveaxis(np.asarray(file[sequence.name]), -1, 0)
            offsets = torch.tensor(arrays["offsets"][rows])
            np.testing.assert_allclose(smpl(betas, pose, trans, offsets), mesh, atol=2e-5)


def test_resuming_ends_with_the_same_bytes(config, monkeypatch):
    _, whole = arrays_of(config)
    fit_frames, calls = corpus_fit.fit_frames, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) > 2:
            raise KeyboardInterrupt
        return fit_frames(*arguments)

    other = AlignConfig(**{**vars(config), "run": "u"})
    monkeypatch.setattr(corpus_fit, "fit_frames", interrupted)
    with pytest.raises(KeyboardInterrupt):
        main(other)
    monkeypatch.setattr(corpus_fit, "fit_frames", fit_frames)
    monkeypatch.setattr(corpus_fit, "calibrate", None)  # subjects are not learned twice
    _, resumed = arrays_of(other)
    assert whole.keys() == resumed.keys()
    for name, array in whole.items():
        np.testing.assert_array_equal(resumed[name], array, err_msg=name)


def test_meshes_in_another_order_are_refused(config, body, smpl, tmp_path):
    shuffled = np.random.default_rng(0).permutation(6890)
    with write_dyna(tmp_path / "odd.h5", body.faces) as writer:
        mesh = smpl(torch.zeros(1, 10), torch.zeros(1, 22, 3), torch.zeros(1, 3)).numpy()
        writer.add("50004_hips", np.repeat(mesh[:, shuffled], 4, 0))
    odd = AlignConfig(**{**vars(config), "dyna": (tmp_path / "odd.h5",)})
    with pytest.raises(DsnetError, match=r"50004_hips.*SMPL's vertex order"):
        main(odd)
    assert not (Run("t").path / "align").exists()
