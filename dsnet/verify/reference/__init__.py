"""The reference: every operation in plain NumPy and float64."""
