"""Subspaces of soft-tissue offsets compared: PCA, the paper's autoencoder and its peers."""
