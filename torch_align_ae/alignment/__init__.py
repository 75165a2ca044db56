"""Alignment of SMPL to registered meshes: the method of Section 3.3."""
