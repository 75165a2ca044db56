"""Soft-tissue dynamics of SMPL bodies."""
