"""What the engines of both frameworks have in common: names of what they return, and loops."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.verify.protocol import Case, Tensors


class Learner(Protocol):
    """One network and its optimizer on one batch; all arrays under canonical names."""

    def first_pass(self) -> tuple[float, Tensors]:
        """Loss and gradients with the initial weights, which stay as they are."""
        ...

    def step(self) -> float:
        """Take one step; the loss before it."""
        ...

    def state(self) -> dict[str, Tensors]:
        """Arrays of `weight`, and Adam's moments `adam_m` and `adam_v`."""
        ...


def learn(case: Case, learner: Learner) -> Tensors:
    """The first pass, and what training leaves after each number of steps that the case names."""
    snapshots = case.options["steps"]
    loss, gradients = learner.first_pass()
    kept = {"loss": np.array([loss], case.dtype), **prefixed("grad", gradients)}
    losses = []
    for step in range(1, max(snapshots, default=0) + 1):
        losses.append(learner.step())
        if step in snapshots:
            for kind, arrays in learner.state().items():
                kept |= prefixed(f"step_{step}/{kind}", arrays)
    return {**kept, "losses": np.array(losses, case.dtype)} if losses else kept


def layers(case: Case, run: Callable[[NDArray], Mapping[str, NDArray]], batch: NDArray) -> Tensors:
    """Every layer's output by `run`, for the batch as a whole or row by row, as the case says."""
    rows = np.split(batch, len(batch)) if case.options["run"] == "singles" else [batch]
    return joined((run(row) for row in rows), axis=0)


def joined(parts: Iterable[Mapping[str, Any]], axis: int) -> Tensors:
    """Parts of every layer's output, put together and named as an engine returns them."""
    parts = list(parts)
    outputs = {name: np.concatenate([part[name] for part in parts], axis) for name in parts[0]}
    return prefixed("layer", outputs)


def prefixed(prefix: str, arrays: Mapping[str, Any]) -> Tensors:
    """The same arrays under `<prefix>/<name>`."""
    return {f"{prefix}/{name}": np.asarray(array) for name, array in arrays.items()}
