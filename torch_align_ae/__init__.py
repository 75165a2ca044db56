"""PyTorch: alignment, the mesh autoencoder, SMPL, and soft tissue as a layer."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bridge.installation import require_packages_of

if TYPE_CHECKING:
    from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
    from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
    from torch_align_ae.body import SMPL, load_body_model, unpose
    from torch_align_ae.tissue import SoftTissue

__all__ = [
    "SMPL",
    "CasasOtaduyAutoencoder",
    "MeshAutoencoder",
    "SoftTissue",
    "load_body_model",
    "unpose",
]
_OUTSIDE_BODY = {
    "CasasOtaduyAutoencoder": "autoencoder.casas_otaduy",
    "MeshAutoencoder": "autoencoder.mesh_autoencoder",
    "SoftTissue": "tissue.soft_tissue",
}
require_packages_of(__name__)


def __getattr__(name: str) -> Any:
    # Lazily, as few stages need what is outside.
    if name in __all__:
        module = _OUTSIDE_BODY.get(name, "body")
        return getattr(import_module(f"torch_align_ae.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
