"""People, motions and flesh in place of licensed data."""
