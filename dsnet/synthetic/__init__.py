"""Synthetic data in place of licensed ones: subjects, motions and soft tissue."""
