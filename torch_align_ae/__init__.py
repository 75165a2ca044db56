"""The PyTorch half of dsnet: from meshes to offsets to latents, and back."""

from typing import TYPE_CHECKING, Any

from torch_align_ae.body import SMPL, load_body_model, unpose

if TYPE_CHECKING:
    from torch_align_ae.autoencoder import CasasOtaduyAutoencoder, MeshAutoencoder

__all__ = ["SMPL", "CasasOtaduyAutoencoder", "MeshAutoencoder", "load_body_model", "unpose"]


def __getattr__(name: str) -> Any:
    # The autoencoders are needed by few stages, so the others do not load them.
    if name in ("CasasOtaduyAutoencoder", "MeshAutoencoder"):
        from torch_align_ae import autoencoder

        return getattr(autoencoder, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
