"""Everything that training needs to go on bit-identically, in one safetensors file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bridge.exchange import load_weights, save_weights

_MOMENTS = ("exp_avg", "exp_avg_sq")


def save_checkpoint(
    path: Path,
    model: nn.Module,
    optimizer: torch.optim.Adam,
    best: dict[str, Tensor],
    history: NDArray[np.float64],
    steps_done: int,
) -> None:
    """Write weights, Adam's moments, the best weights so far and the loss history atomically.

    No random state is kept: each epoch's order follows from the seed and the
    epoch's number, and nothing else is drawn.
    """
    arrays: dict[str, NDArray] = {f"best.{k}": _numpy(value) for k, value in best.items()}
    for name, parameter in model.named_parameters():
        arrays[f"model.{name}"] = _numpy(parameter)
        for moment in _MOMENTS:
            arrays[f"{moment}.{name}"] = _numpy(optimizer.state[parameter][moment])
    save_weights(
        path, {**arrays, "history": history, "steps_done": np.array([steps_done], np.int64)}
    )


def load_checkpoint(
    path: Path, model: nn.Module, optimizer: torch.optim.Adam
) -> tuple[dict[str, Tensor], NDArray[np.float64], int]:
    """Restore `model` and `optimizer`; return the best weights, the history and the step count."""
    arrays = load_weights(path)
    steps_done = int(arrays["steps_done"][0])
    with torch.no_grad():
        for name, parameter in model.named_parameters():
            parameter.copy_(torch.from_numpy(arrays[f"model.{name}"]))
            state = optimizer.state[parameter]
            state["step"] = torch.tensor(float(steps_done), device=parameter.device)
            for moment in _MOMENTS:
                state[moment] = torch.from_numpy(arrays[f"{moment}.{name}"]).to(parameter.device)
    best = {
        name.removeprefix("best."): torch.from_numpy(value)
        for name, value in arrays.items()
        if name.startswith("best.")
    }
    return best, arrays["history"], steps_done


def _numpy(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy()
