"""Alignment, the mesh autoencoder and SMPL in PyTorch: from meshes to latents, and back."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bridge.installation import require_packages_of

if TYPE_CHECKING:
    from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
    from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
    from torch_align_ae.body import SMPL, load_body_model, unpose

__all__ = ["SMPL", "CasasOtaduyAutoencoder", "MeshAutoencoder", "load_body_model", "unpose"]
_AUTOENCODERS = {
    "CasasOtaduyAutoencoder": "autoencoder.casas_otaduy",
    "MeshAutoencoder": "autoencoder.mesh_autoencoder",
}
require_packages_of(__name__)


def __getattr__(name: str) -> Any:
    # Lazily, as few stages need the autoencoders.
    if name in __all__:
        module = _AUTOENCODERS.get(name, "body")
        return getattr(import_module(f"torch_align_ae.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
