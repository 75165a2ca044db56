"""The codes that are compared, and how the network of each is built and begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import torch

from benchmarks.subspaces.data import SubspaceData
from benchmarks.subspaces.residual import (
    RESIDUAL_WIDTH,
    ResidualAutoencoder,
    initialise_with_pca,
)
from bridge.paper import ALTERNATIVE_WIDTHS, CASAS_OTADUY_WIDTHS, INFERRED_WIDTHS
from torch_align_ae import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.codes import Normaliser, fit_normaliser
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder, initialise_with_modes
from torch_align_ae.autoencoder.stage_train_ae import PRESETS, PresetName, mode_sample

OffsetAutoencoder: TypeAlias = MeshAutoencoder | CasasOtaduyAutoencoder | ResidualAutoencoder


@dataclass(frozen=True)
class SubspaceCode:
    """One code; its size is not part of it."""

    label: str
    """As in tables."""
    kind: Literal["pca", "mesh", "casas_otaduy", "residual"]
    """Which network."""
    widths: tuple[int, ...] = ()
    """Of the network's layers between offsets and latents."""
    preset: PresetName = "measured"
    """Whose normalisation and schedule it is trained with; of a mesh autoencoder also how its
    weights begin."""
    searched: bool = True
    """Whether its learning rate is searched for, instead of the preset's."""


def _joined(widths: tuple[int, ...]) -> str:
    return "-".join(map(str, widths))


def _mesh(widths: tuple[int, ...], preset: PresetName, *, searched: bool = False) -> SubspaceCode:
    rate = "rate searched" if searched else "the paper's rate"
    inner = widths[1:]
    label = f"mesh autoencoder {_joined(inner)}, `{preset}`, {rate}"
    return SubspaceCode(label, "mesh", inner, preset, searched)


CODES: dict[str, SubspaceCode] = {
    "pca": SubspaceCode("PCA", "pca", searched=False),
    "residual": SubspaceCode(
        "residual autoencoder from PCA (SoftSMPL-like; widths ours)", "residual", (RESIDUAL_WIDTH,)
    ),
    "mesh_measured": _mesh(INFERRED_WIDTHS, "measured"),
    "mesh_literal": _mesh(INFERRED_WIDTHS, "literal"),
    "mesh_searched": _mesh(INFERRED_WIDTHS, "measured", searched=True),
    "mesh_alternative_measured": _mesh(ALTERNATIVE_WIDTHS, "measured"),
    "mesh_alternative_literal": _mesh(ALTERNATIVE_WIDTHS, "literal"),
    "casas_otaduy": SubspaceCode(
        f"Casas-Otaduy {_joined(CASAS_OTADUY_WIDTHS[1:-1])}",
        "casas_otaduy",
        CASAS_OTADUY_WIDTHS[1:-1],
    ),
}
"""The cheap ones first; `measured` and `literal` as in `stage_train_ae.py`."""


def new_network(
    code: SubspaceCode, size: int, data: SubspaceData
) -> tuple[OffsetAutoencoder, Normaliser]:
    """A network with `size` latents as it begins, and the normaliser of what it is given."""
    preset = PRESETS[code.preset]
    normaliser = fit_normaliser(preset.normalisation, data.offsets_m, data.split.train)
    vertices = data.offsets_m.shape[1]
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(data.seed)
        if code.kind == "casas_otaduy":
            return CasasOtaduyAutoencoder((3 * vertices, *code.widths), size), normaliser
        if code.kind == "residual":
            network = ResidualAutoencoder(vertices, size, len(data.pca.components))
            initialise_with_pca(network, data.pca, normaliser)
            return network, normaliser
        mesh = MeshAutoencoder((vertices, *code.widths), size)
    if preset.initialisation == "modes":
        sample = torch.from_numpy(mode_sample(data.offsets_m, data.split, data.seed))
        initialise_with_modes(mesh, normaliser.normalise(sample), data.seed)
    return mesh, normaliser
