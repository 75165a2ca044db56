"""The reference of `dsnet_plus` as a stream is the prediction of the whole clip."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model, pose_vertices
from bridge.motion import unpack_theta
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.models import PlusModel, predict_whole
from dsnet.verify import draws
from dsnet.verify.reference import oscillators

BODY = load_body_model("embedded:female")


@pytest.mark.parametrize("look_ahead", [0, 1])
def test_a_stream_is_the_whole_clip(look_ahead):
    arrays = draws.tissue(0, BODY) | {"look_ahead": np.array([look_ahead], np.int32)}
    model = TrainedPlus.from_arrays(arrays)
    given = draws.stream(0, 12, 1)
    theta, betas = given["theta"][:, 0].astype(np.float64), given["betas"][0].astype(np.float64)
    theta[: look_ahead + 3] = theta[look_ahead + 2]  # at rest before it moves
    offsets_m = np.concatenate(list(predict_whole(PlusModel(model, BODY), theta, betas).offsets_m))
    shapes = np.tile(betas, (len(theta), 1))
    whole = pose_vertices(BODY, shapes, *unpack_theta(theta), offsets_m)
    found = oscillators.posed_vertices(model, BODY, theta, betas)
    np.testing.assert_allclose(found[look_ahead:], whole[: len(whole) - look_ahead], atol=1e-6)
    assert np.abs(offsets_m).max() > 1e-3
