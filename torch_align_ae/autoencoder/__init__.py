"""The mesh autoencoder of Figure 3, the one it is compared with, training and codecs."""
