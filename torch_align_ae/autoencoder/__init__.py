"""Figure 3's autoencoder, its peer, its training, and the codec made of it."""

from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.codes import Codec, PcaCodec, load_codec
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder, parameter_count

__all__ = [
    "CasasOtaduyAutoencoder",
    "Codec",
    "MeshAutoencoder",
    "PcaCodec",
    "load_codec",
    "parameter_count",
]
