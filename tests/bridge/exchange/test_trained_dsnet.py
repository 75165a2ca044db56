"""Which of a run's predictors are DSNet, and what is refused in their place."""

from __future__ import annotations

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.trained_dsnet import dsnets_of, load_trained_dsnet
from bridge.runs import Artifact, ArtifactWriter


def trained(tmp_path, **arrays) -> Artifact:
    writer = ArtifactWriter(tmp_path / "train", "train", data="synthetic")
    for name, weights in arrays.items():
        save_weights(writer.file_path(f"{name}.safetensors"), weights)
    writer.record(default=next(iter(arrays)), predictors={name: {} for name in arrays})
    return writer.finish()


def test_another_system_is_not_dsnet(tmp_path):
    weights = {"fc_enc_1/kernel": np.zeros((79, 64), np.float32)}
    made = trained(tmp_path, dsnet_like=weights, dsnet_faithful=weights)
    assert dsnets_of(made) == ["dsnet_faithful"]
    assert load_trained_dsnet(made, "dsnet_faithful").scaling.input_mean.shape == (79,)
    with pytest.raises(DsnetError, match=r"'dsnet_like', which is not DSNet; .*dsnet_faithful"):
        load_trained_dsnet(made)


@pytest.mark.parametrize("kernel", [{}, {"fc_enc_1/kernel": np.zeros((148, 64), np.float32)}])
def test_weights_of_other_inputs_are_refused(tmp_path, kernel):
    made = trained(tmp_path, dsnet_faithful={"other": np.zeros(1, np.float32), **kernel})
    with pytest.raises(DsnetError, match=r"of a network of \d+ inputs; expected 79"):
        load_trained_dsnet(made)
