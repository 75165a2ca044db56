"""The oscillators as Keras trains them, in PyTorch: `dsnet verify` compares the two.

Weights have the names that Keras gives them, and arrays its axes, (T, K, B, 3).
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from bridge.tissue.learning import GAIN_PRIOR, NODE_PRIOR, PEOPLE_PRIOR, QUIET_M, QUIET_SHARE
from torch_align_ae.tissue.springs import make_springs, simulate, smoothed


class TissueWindows(nn.Module):
    """Windows of B clips, simulated from given states under given loads."""

    def __init__(self, weights: Mapping[str, Tensor], laplacian: Tensor) -> None:
        super().__init__()
        for name, tensor in weights.items():
            self.register_parameter(name, nn.Parameter(tensor))
        self._laplacian, self._twice = laplacian, laplacian @ laplacian

    def forward(self, given: Mapping[str, Tensor]) -> Tensor:
        """Offsets (T, K, B, 3), metres; `given` is a `tf_dsnet.oscillators.Batch`."""
        w = dict(self.named_parameters())
        logs = {n: (w[f"log_{n}"] + w[f"by_node_{n}"])[:, 0] for n in NODE_PRIOR}
        deviation = (given["features"] @ w["slopes"])[..., 0].T
        residual = w["residual"] - w["residual"].mean(0)
        deviation = (deviation + given["shares"] @ residual[..., 0])[:, None]  # (B, 1, K)
        springs = make_springs(
            logs,
            deviation,
            w["stiffening_power"],
            given["normals"].permute(1, 2, 0),
            (self._laplacian, self._twice),
        )
        inertia, gravity = (
            torch.exp(logs[f"{cause}_gain"]) * given[cause].permute(2, 0, 3, 1)
            for cause in ("inertia", "gravity")
        )
        loads = smoothed(inertia + gravity, w["taps"] / w["taps"].sum())
        now, before = (given[name].permute(1, 2, 0) for name in ("now", "before"))
        frames, *_ = simulate(springs, loads, now, before)
        return torch.stack(frames).permute(0, 3, 1, 2)

    def loss(self, given: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Squared error over energy of all clips, with a small term in which clips count alike; and
        the prior on the weights."""
        counted, target = given["counted"], given["target"]
        error, energy = (
            (counted * values.square()).mean((0, 1, 3)) for values in (self(given) - target, target)
        )
        quiet = counted.mean((0, 1, 3)) * QUIET_M**2
        overall = error.sum() / energy.sum() + QUIET_SHARE * (error / (energy + quiet)).mean()
        w = dict(self.named_parameters())
        prior = PEOPLE_PRIOR * w["residual"].square().mean()
        for name, strength in NODE_PRIOR.items():
            prior = prior + strength * w[f"by_node_{name}"].square().mean()
        for name in ("inertia_gain", "gravity_gain"):
            prior = prior + GAIN_PRIOR * w[f"log_{name}"].square().sum()
        return overall, prior
