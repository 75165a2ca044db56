"""Graphs in files that dsnet did not write."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from onnx import ModelProto, TensorProto, helper, numpy_helper

from bridge import DsnetError
from bridge.runtime.onnx_graph import held_arrays


def _model(weights: TensorProto) -> ModelProto:
    x, y = (helper.make_tensor_value_info(name, 1, [1, 3]) for name in "xy")
    node = helper.make_node("Mul", ["x", "w"], ["y"])
    return helper.make_model(helper.make_graph([node], "g", [x], [y], [weights]))


def test_arrays_of_another_size_or_elsewhere_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "graph.onnx"
    good = numpy_helper.from_array(np.ones((1, 3), np.float32), "w")
    path.write_bytes(_model(good).SerializeToString())
    assert held_arrays(path)["w"].tolist() == [[1, 1, 1]]
    short, elsewhere = TensorProto(), TensorProto()
    short.CopyFrom(good)
    short.dims[1] = 6
    elsewhere.CopyFrom(good)
    elsewhere.ClearField("raw_data")
    elsewhere.data_location = TensorProto.EXTERNAL
    elsewhere.external_data.add(key="location", value="/etc/passwd")
    for weights in (short, elsewhere):
        path.write_bytes(_model(weights).SerializeToString())
        with pytest.raises(DsnetError, match="does not load"):
            held_arrays(path)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(DsnetError, match="does not load"):
            held_arrays(path)
