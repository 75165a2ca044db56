"""Figure 3's autoencoder, its peers, its training, and the codec made of it."""

from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.codec import Codec, load_codec
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder, parameter_count
from torch_align_ae.autoencoder.pca import PcaCodec

__all__ = [
    "CasasOtaduyAutoencoder",
    "Codec",
    "MeshAutoencoder",
    "PcaCodec",
    "load_codec",
    "parameter_count",
]
