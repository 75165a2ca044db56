"""Figure 3's autoencoder, its peer, its training, and the codec made of it."""
