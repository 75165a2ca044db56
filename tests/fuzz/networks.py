"""Damaged weights."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import safetensors.numpy
from hypothesis import strategies as st

from bridge.exchange import load_weights
from bridge.tissue.trained_plus import TrainedPlus
from tests.fuzz.mutations import Draw, Files, damaged, damaged_json, damaged_npy

PACKAGED = Path(__file__).parents[2] / "dsnet/prediction/packaged/female/dsnet_plus.safetensors"


@st.composite
def _weights(draw: Draw, plus: dict[str, np.ndarray]) -> Files:
    """The packaged model's weights: other arrays, another header, other bytes."""
    arrays = dict(plus)
    if draw(st.booleans()):
        for _ in range(draw(st.integers(1, 3))):
            name = draw(st.sampled_from(sorted(plus)))
            content = damaged_npy(draw, plus[name])
            changed = _loaded(content)
            arrays.pop(name, None)
            if changed is not None:
                arrays[name] = changed
        return {"weights.safetensors": safetensors.numpy.save(arrays)}
    content = safetensors.numpy.save({name: arrays[name] for name in sorted(arrays)[:4]})
    size = int.from_bytes(content[:8], "little")
    if draw(st.booleans()):
        return {"weights.safetensors": damaged(draw, content)}
    header = damaged_json(draw, json.loads(content[8 : 8 + size]))
    kinds = st.sampled_from(("BF16", "F8_E4M3", "F4", "BOOL", "C64", "U64", "I8", "F16", "X"))
    text = json.dumps(header).replace("F32", draw(kinds)).encode()
    return {"weights.safetensors": len(text).to_bytes(8, "little") + text + content[8 + size :]}


def _loaded(content: bytes) -> np.ndarray | None:
    """An array that safetensors can write."""
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
        safetensors.numpy.save({"a": array})
    except Exception:
        return None
    return array


def read_weights(folder: Path) -> None:
    """As a trained model."""
    TrainedPlus.from_arrays(load_weights(folder / "weights.safetensors"))


def weights_files() -> st.SearchStrategy[Files]:
    """Of the packaged model."""
    return _weights(load_weights(PACKAGED))
